"""Fabrics: kinds, colors and random traits of pieces of cloth."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from relight.figures.catalogue.schema import entries
from relight.figures.texture import Color, as_color, lattice_value

Kind = Literal[
    "plain", "jersey", "stripes", "fine stripes", "pinstripe", "check", "print", "logo",
    "melange", "tweed", "knit", "corduroy", "denim", "leather",
]  # fmt: skip
# The random traits of a piece of cloth. Equal numbers are one random number: those of different kinds of fabric.
TRAITS = {
    "unevenness": 0, "yarn width": 1, "linen": 7,
    "stripe width": 2, "third stripe": 3, "third stripe gaps": 4,
    "tartan": 2,
    "stitch size": 2, "ribs": 3, "rib width": 4,
    "wale width": 2, "streaks": 2,
    "print": 2, "print size": 3,
    "emblem": 2, "emblem place": 3, "sleeve stripe": 4, "emblem size": 5, "letters": 6,
    "soil": 10, "age": 11, "stains": 13,
    "third color": 20, "fourth color": 21,
    "satin": 30,
    "dye": 40,
}  # fmt: skip


@dataclass(frozen=True)
class Fabric:
    """The material of a garment.

    Attributes:
        kind: how it is woven.
        first: linear albedo of the ground.
        second: linear albedo of the pattern on it.
        size: factor of the pattern's size.
        seed: random seed of its irregularities and details.
    """

    kind: Kind
    first: Color
    second: Color
    size: float
    seed: int


def colors(section: str) -> list[Color]:
    """Returns the colors, linear albedo, of a section of the catalogue, such as "neutrals"."""
    return list(entries("colors", section, Color).values())


def sample_fabric(rng: np.random.Generator, kinds: tuple[Kind, ...], muted: bool) -> Fabric:
    """Draws a fabric.

    Args:
        rng: random generator.
        kinds: drawn with equal probabilities.
        muted: whether neutral colors are usual (80 % of pieces, else 42 %), as of trousers and coats.
    """
    kind: Kind = rng.choice(kinds).item()
    pool = colors("neutrals" if rng.random() < (0.8 if muted else 0.42) else "colors")
    first = np.array(pool[rng.integers(len(pool))])
    contrasting = [  # much lighter or darker than the first
        color
        for color in np.array(colors("neutrals") + colors("colors"))
        if abs(np.log((color.mean() + 0.02) / (first.mean() + 0.02))) > 0.9
    ]
    second = contrasting[rng.integers(len(contrasting))]
    if kind in ("denim", "leather"):
        pool = colors(f"{kind}s")
        first = np.array(pool[rng.integers(len(pool))])
    tint, lightness = rng.normal(0, 0.12, 3) * [1, 0.6, 0.8], rng.normal(0, 0.1)
    first = np.clip(first * np.exp(tint + lightness), 0.012, 0.82)
    size = float(np.exp(rng.normal(0, 0.3)))
    return Fabric(kind, as_color(first), as_color(second), size, int(rng.integers(2**31)))


def trait(fabric: Fabric, name: str, panel: int = 0) -> float:
    """Returns a random property in [0,1) of a piece of cloth.

    Args:
        fabric: its seed gives the property.
        name: of the property, one of TRAITS.
        panel: number of a panel, for properties in which panels differ.
    """
    return lattice_value(TRAITS[name] + panel, 77, fabric.seed)


def further_color(fabric: Fabric, name: str) -> np.ndarray:
    """Returns the linear albedo (3,) of a further color of the fabric, "third color" or "fourth color"."""
    pool = colors("neutrals") + colors("colors")
    return np.array(pool[int(trait(fabric, name) * len(pool))])
