"""Fabrics: albedo as a function of cloth coordinates in metres, in the colours that wardrobes have. No shading."""

from dataclasses import dataclass

import numpy as np

# linear albedo: neutrals are worn more often than colours
NEUTRALS = {
    "white": (0.78, 0.77, 0.74),
    "off-white": (0.68, 0.63, 0.53),
    "light grey": (0.42, 0.42, 0.42),
    "grey": (0.18, 0.18, 0.19),
    "charcoal": (0.055, 0.057, 0.062),
    "black": (0.022, 0.022, 0.024),
    "navy": (0.018, 0.030, 0.085),
    "beige": (0.46, 0.36, 0.24),
    "camel": (0.36, 0.20, 0.09),
    "brown": (0.11, 0.055, 0.030),
    "olive": (0.12, 0.12, 0.050),
    "khaki": (0.30, 0.25, 0.15),
}
COLOURS = {
    "red": (0.52, 0.025, 0.030),
    "burgundy": (0.17, 0.016, 0.032),
    "rust": (0.38, 0.095, 0.030),
    "orange": (0.70, 0.20, 0.035),
    "mustard": (0.55, 0.31, 0.045),
    "yellow": (0.74, 0.55, 0.09),
    "green": (0.040, 0.22, 0.080),
    "forest": (0.018, 0.075, 0.040),
    "sage": (0.24, 0.31, 0.21),
    "teal": (0.020, 0.17, 0.19),
    "sky": (0.27, 0.47, 0.68),
    "blue": (0.030, 0.095, 0.42),
    "cobalt": (0.012, 0.045, 0.50),
    "purple": (0.14, 0.040, 0.23),
    "lilac": (0.46, 0.35, 0.60),
    "pink": (0.70, 0.29, 0.37),
    "fuchsia": (0.56, 0.040, 0.21),
    "mint": (0.40, 0.65, 0.51),
}
DENIMS = ((0.030, 0.055, 0.135), (0.075, 0.135, 0.27), (0.20, 0.30, 0.46), (0.018, 0.020, 0.028), (0.30, 0.31, 0.33))
LEATHERS = ((0.022, 0.020, 0.020), (0.085, 0.038, 0.020), (0.17, 0.075, 0.032), (0.12, 0.016, 0.018))


@dataclass(frozen=True)
class Fabric:
    """kind: see `weave`; first, second: names or linear albedo of the ground and the figure; size: of the repeat, a
    factor; seed: of what is irregular in it."""

    kind: str
    first: tuple[float, float, float]
    second: tuple[float, float, float]
    size: float
    seed: int


def sample_fabric(rng: np.random.Generator, kinds: tuple[str, ...], muted: bool) -> Fabric:
    """Draws a fabric of one of the kinds; `muted` garments (trousers, coats) are mostly neutral."""
    kind = str(rng.choice(kinds))
    pool = list((NEUTRALS if rng.random() < (0.8 if muted else 0.42) else COLOURS).values())
    first = np.array(pool[rng.integers(len(pool))])
    everything = [np.array(c) for c in (*NEUTRALS.values(), *COLOURS.values())]
    far = [c for c in everything if abs(np.log((c.mean() + 0.02) / (first.mean() + 0.02))) > 0.9]
    second = far[rng.integers(len(far))]
    if kind == "denim":
        first = np.array(DENIMS[rng.integers(len(DENIMS))])
    if kind == "leather":
        first = np.array(LEATHERS[rng.integers(len(LEATHERS))])
    first = np.clip(first * np.exp(rng.normal(0, 0.12, 3) * [1, 0.6, 0.8] + rng.normal(0, 0.1)), 0.012, 0.82)
    return Fabric(
        kind,
        tuple(map(float, first)),
        tuple(map(float, second)),
        float(np.exp(rng.normal(0, 0.3))),
        int(rng.integers(2**31)),
    )


def lattice(i: np.ndarray, j: np.ndarray, seed: int) -> np.ndarray:
    """A hash of integer lattice points to [0,1), the same on every machine."""
    with np.errstate(over="ignore"):
        h = i.astype(np.int64).astype(np.uint32) * np.uint32(374761393) + j.astype(np.int64).astype(
            np.uint32
        ) * np.uint32(668265263)
        h = (h ^ np.uint32((seed * 2246822519) & 0xFFFFFFFF)) * np.uint32(3266489917)
        h = (h ^ (h >> np.uint32(15))) * np.uint32(2654435761)
    return ((h ^ (h >> np.uint32(13))) & np.uint32(0xFFFFFF)).astype(np.float64) / 2**24


def noise(x: np.ndarray, y: np.ndarray, seed: int = 0) -> np.ndarray:
    """Value noise in [0,1] with unit features."""
    i, j = np.floor(x), np.floor(y)
    a, b = x - i, y - j
    a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
    low = lattice(i, j, seed) * (1 - a) + lattice(i + 1, j, seed) * a
    high = lattice(i, j + 1, seed) * (1 - a) + lattice(i + 1, j + 1, seed) * a
    return low * (1 - b) + high * b


def band(x: np.ndarray, period: float, share: float, soft: float = 0.0012) -> np.ndarray:
    """1 inside stripes that fill `share` of each period, edges `soft` metres wide."""
    d = np.abs((x / period + 0.5) % 1 - 0.5) * period
    return np.clip((share * period / 2 - d) / soft + 0.5, 0, 1)


def motif(kind: int, u: np.ndarray, v: np.ndarray, cell: float, seed: int) -> np.ndarray:
    """Scattered dots, flowers or leaves: coverage in [0,1]."""
    i, j = np.floor(u / cell), np.floor(v / cell + 0.5 * (np.floor(u / cell) % 2))
    x = u / cell - i - 0.5 - 0.25 * (lattice(i, j, seed) - 0.5)
    y = v / cell + 0.5 * (i % 2) - j - 0.5 - 0.25 * (lattice(i, j, seed + 1) - 0.5)
    turn = 2 * np.pi * lattice(i, j, seed + 2)
    r, angle = np.hypot(x, y), np.arctan2(y, x) + turn
    if kind == 0:
        size = np.full_like(r, 0.24)
    elif kind == 1:
        size = 0.30 * (0.7 + 0.3 * np.cos(5 * angle)) * (0.75 + 0.5 * lattice(i, j, seed + 3))
    else:
        size = 0.36 * np.abs(np.cos(angle)) ** 2.5 + 0.03
    inside = np.clip((size - r) * cell / 0.0012 + 0.5, 0, 1)
    heart = np.clip((0.07 - r) * cell / 0.0012 + 0.5, 0, 1) if kind == 1 else 0
    return inside - 0.6 * heart


def weave(fabric: Fabric, name: str, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Linear albedo (...,3) of the fabric at cloth coordinates u across, v along (metres) of the panel `name`."""
    first, second, s = np.array(fabric.first), np.array(fabric.second), fabric.size
    offset = 7.31 * (sum(map(ord, name)) % 17)
    fine = (
        1
        + 0.10 * (noise(u * 800 + offset, v * 800, fabric.seed) - 0.5)
        + 0.08 * (noise(u * 14 + offset, v * 14, fabric.seed + 9) - 0.5)
    )
    share = np.zeros_like(u)
    if fabric.kind == "stripes":
        share = band(v, 0.055 * s, 0.42)
    elif fabric.kind == "fine stripes":
        share = band(u, 0.016 * s, 0.38, 0.0008)
    elif fabric.kind == "pinstripe":
        share = 0.55 * band(u, 0.022 * s, 0.07, 0.0008)
    elif fabric.kind == "check":
        share = 0.5 * band(u, 0.06 * s, 0.45) + 0.5 * band(v, 0.06 * s, 0.45)
    elif fabric.kind == "print":
        share = motif(fabric.seed % 3, u + offset, v, 0.055 * s, fabric.seed)
    elif fabric.kind == "logo" and name == "front":
        x, y = u / 0.09, (v - 0.36) / 0.09
        r = np.hypot(x, y)
        shapes = (
            (np.abs(r - 0.85) < 0.15) | ((np.abs(x) < 0.45) & (np.abs(y) < 0.14)),
            (np.abs(y) < 0.9 - np.abs(x) * 1.2) & (np.abs(y) > 0.45 - np.abs(x) * 1.2),
            (np.abs(x) < 1.3) & (band(v - 0.36, 0.03, 0.5) > 0.5) & (np.abs(y) < 0.8),
        )
        share = shapes[fabric.seed % 3].astype(float)
    elif fabric.kind == "melange":
        share = 0.28 * noise(u * 260 + offset, v * 900, fabric.seed + 1)
        second = 0.5 * (second + 0.5)
    elif fabric.kind == "tweed":
        share = 0.45 * (noise(u * 420 + offset, v * 420, fabric.seed + 1) > 0.62) + 0.15 * band(u + v, 0.012, 0.5)
        second = 0.5 * (first + second)
    elif fabric.kind == "knit":
        column = np.abs((u / 0.006) % 1 - 0.5)
        share = 0.35 * np.clip(band(v + 0.004 * column, 0.006, 0.35, 0.002) + 0.6 * (column < 0.08), 0, 1)
        second = 0.45 * first
    elif fabric.kind == "denim":
        twill = band(u + 0.6 * v, 0.0035, 0.5, 0.0015)
        worn = np.exp(-((np.abs(u) - 0.01) ** 2) / 0.0035) * np.clip(
            noise(u * 9 + offset, v * 4, fabric.seed) + 0.1, 0, 1
        )
        share = 0.10 * twill + 0.16 * noise(u * 500 + offset, v * 130, fabric.seed + 3) + 0.34 * worn
        second = 0.5 * first + 0.5 * np.array([0.48, 0.53, 0.60])
    elif fabric.kind == "leather":
        share = (
            0.25 * noise(u * 300 + offset, v * 300, fabric.seed)
            + 0.3 * noise(u * 30 + offset, v * 22, fabric.seed + 1) ** 3
        )
        second = 2.2 * first
    return (first + (second - first) * share[..., None]) * fine[..., None]
