"""Fabrics: kinds, colors and random traits of pieces of cloth."""

from dataclasses import dataclass

import numpy as np

from relight.figures.catalogue.schema import entries
from relight.figures.texture import Color, lattice


@dataclass(frozen=True)
class Fabric:
    """The material of a garment.

    Attributes:
        kind: one of `weaves.WEAVES`.
        first: linear albedo of the ground.
        second: linear albedo of the pattern on it.
        size: factor of the pattern's size.
        seed: random seed of its irregularities and details.
    """

    kind: str
    first: Color
    second: Color
    size: float
    seed: int


def as_color(values: np.ndarray) -> Color:
    """Returns an array (3,) as a tuple."""
    red, green, blue = values.tolist()
    return red, green, blue


def colors(section: str) -> list[Color]:
    """Returns the colors of a section of the catalogue."""
    return list(entries("colors", section, Color).values())


def sample_fabric(rng: np.random.Generator, kinds: tuple[str, ...], muted: bool) -> Fabric:
    """Draws a fabric of one of the kinds; `muted` ones, for trousers and coats, are mostly of neutral colors."""
    kind = str(rng.choice(kinds))
    pool = colors("neutrals" if rng.random() < (0.8 if muted else 0.42) else "colors")
    first = np.array(pool[rng.integers(len(pool))])
    contrasting = [
        color
        for color in np.array(colors("neutrals") + colors("colors"))
        if abs(np.log((color.mean() + 0.02) / (first.mean() + 0.02))) > 0.9
    ]
    second = contrasting[rng.integers(len(contrasting))]
    if kind in ("denim", "leather"):
        pool = colors(f"{kind}s")
        first = np.array(pool[rng.integers(len(pool))])
    first = np.clip(first * np.exp(rng.normal(0, 0.12, 3) * [1, 0.6, 0.8] + rng.normal(0, 0.1)), 0.012, 0.82)
    size = float(np.exp(rng.normal(0, 0.3)))
    return Fabric(kind, as_color(first), as_color(second), size, int(rng.integers(2**31)))


def trait(fabric: Fabric, number: int) -> float:
    """Returns a random property in [0,1) of a piece of cloth, one for each number."""
    return float(lattice(np.array(number), np.array(77), fabric.seed))


def palette(fabric: Fabric, number: int) -> np.ndarray:
    """Returns a further color (3,) of the fabric."""
    pool = colors("neutrals") + colors("colors")
    return np.array(pool[int(trait(fabric, 20 + number) * len(pool))])
