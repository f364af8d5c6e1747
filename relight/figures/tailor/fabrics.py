"""Fabrics: albedo as a function of cloth coordinates in metres, without shading, in common colours of clothes."""

from dataclasses import dataclass

import numpy as np

from relight.figures.texture import lattice, noise

Color = tuple[float, float, float]  # linear albedo of red, green and blue

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


MIN_TEXELS = 1.4  # size of the smallest feature
GRAINS = {  # standard deviations of ln albedo: warp, weft, flecks, blotches
    "plain": (0.085, 0.10, 0.055, 0.055),
    "jersey": (0.02, 0.04, 0.09, 0.055),
    "stripes": (0.05, 0.06, 0.06, 0.045),
    "fine stripes": (0.05, 0.05, 0.04, 0.045),
    "pinstripe": (0.07, 0.05, 0.06, 0.045),
    "check": (0.06, 0.06, 0.06, 0.045),
    "print": (0.05, 0.06, 0.05, 0.045),
    "logo": (0.06, 0.06, 0.075, 0.05),
    "melange": (0.04, 0.04, 0.07, 0.045),
    "tweed": (0.04, 0.04, 0.07, 0.045),
    "knit": (0.05, 0.08, 0.08, 0.06),
    "corduroy": (0.08, 0.02, 0.06, 0.06),
    "denim": (0.04, 0.03, 0.05, 0.05),
    "leather": (0.0, 0.0, 0.06, 0.07),
}


@dataclass(frozen=True)
class Fabric:
    """The material of a garment.

    Attributes:
        kind: see `weave`.
        first: linear albedo of the ground.
        second: linear albedo of the pattern on it.
        size: factor of the pattern's size.
        seed: of its irregularities and details.
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


def sample_fabric(rng: np.random.Generator, kinds: tuple[str, ...], muted: bool) -> Fabric:
    """Draws a fabric of one of the kinds; `muted` ones, for trousers and coats, are mostly of neutral colours."""
    kind = str(rng.choice(kinds))
    pool = list((NEUTRALS if rng.random() < (0.8 if muted else 0.42) else COLOURS).values())
    first = np.array(pool[rng.integers(len(pool))])
    all_colours = [np.array(c) for c in (*NEUTRALS.values(), *COLOURS.values())]
    contrasting = [c for c in all_colours if abs(np.log((c.mean() + 0.02) / (first.mean() + 0.02))) > 0.9]
    second = contrasting[rng.integers(len(contrasting))]
    if kind == "denim":
        first = np.array(DENIMS[rng.integers(len(DENIMS))])
    if kind == "leather":
        first = np.array(LEATHERS[rng.integers(len(LEATHERS))])
    first = np.clip(first * np.exp(rng.normal(0, 0.12, 3) * [1, 0.6, 0.8] + rng.normal(0, 0.1)), 0.012, 0.82)
    return Fabric(
        kind,
        as_color(first),
        as_color(second),
        float(np.exp(rng.normal(0, 0.3))),
        int(rng.integers(2**31)),
    )


def grain(
    u: np.ndarray, v: np.ndarray, width: float, height: float, texel: float, seed: int, offset: float = 0.0
) -> np.ndarray:
    """Returns noise of mean 0 and standard deviation about 1 with features of `width` by `height` metres.

    Features finer than MIN_TEXELS texels are enlarged, with the lower contrast of averages of independent ones.
    """
    smallest = MIN_TEXELS * texel
    x, y = max(width, smallest), max(height, smallest)
    return float(np.sqrt(width / x * height / y)) * 5.0 * (noise(u / x + offset, v / y, seed) - 0.5)


def band(x: np.ndarray, period: float, share: float, soft: float = 0.0012) -> np.ndarray:
    """Returns 1 inside stripes that fill `share` of each period, with edges of `soft` metres."""
    d = np.abs((x / period + 0.5) % 1 - 0.5) * period
    return np.clip((share * period / 2 - d) / soft + 0.5, 0, 1)


def motif(kind: int, u: np.ndarray, v: np.ndarray, cell: float, seed: int) -> np.ndarray:
    """Returns the coverage in [0,1] of scattered motifs of a kind (0 dots, 1 flowers, 2 leaves)."""
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


def trait(fabric: Fabric, number: int) -> float:
    """Returns a random property in [0,1) of a piece of cloth, one for each number."""
    return float(lattice(np.array(number), np.array(77), fabric.seed))


def palette(fabric: Fabric, number: int) -> np.ndarray:
    """Returns a further colour (3,) of the fabric."""
    colours = [*NEUTRALS.values(), *COLOURS.values()]
    return np.array(colours[int(trait(fabric, 20 + number) * len(colours))])


def irregular(fabric: Fabric, u: np.ndarray, v: np.ndarray, offset: float, texel: float) -> np.ndarray:
    """Returns the logarithm (h,w) of the factor by which yarn and dye vary the albedo."""
    warp, weft, fleck, blotch = GRAINS.get(fabric.kind, GRAINS["plain"])
    strength, linen = 0.7 + 0.6 * trait(fabric, 0), trait(fabric, 7)
    warp, weft, fleck = warp * (0.25 + linen), weft * (0.25 + linen), fleck * (1.6 - linen)
    yarn = 0.0012 + 0.0014 * trait(fabric, 1)
    seed = fabric.seed
    out = warp * grain(u, v, yarn, 0.045, texel, seed + 31, offset)
    out = out + weft * grain(u, v, 0.038, yarn, texel, seed + 32, offset)
    out += fleck * grain(u, v, 0.0022, 0.0030, texel, seed + 33, offset)
    out += blotch * grain(u, v, 0.0055, 0.0075, texel, seed + 34, offset)
    out += 0.6 * blotch * grain(u, v, 0.016, 0.021, texel, seed + 35, offset)
    return strength * out + 0.035 * grain(u, v, 0.09, 0.13, texel, seed + 36, offset)


def weave(fabric: Fabric, name: str, u: np.ndarray, v: np.ndarray, texel: float = 0.001) -> np.ndarray:
    """Computes the albedo of a fabric.

    Args:
        fabric: its kind is one of the keys of GRAINS.
        name: of the panel.
        u: (...) cloth coordinate across, metres.
        v: (...) cloth coordinate along, metres.
        texel: metres between the samples; finer details are averaged.

    Returns:
        (...,3) linear albedo.
    """
    first, second, s = np.array(fabric.first, u.dtype), np.array(fabric.second, u.dtype), fabric.size
    seed, offset = fabric.seed, 7.31 * (sum(map(ord, name)) % 17)
    soft = max(0.0012, texel)
    share, color = np.zeros(u.shape, u.dtype), None
    if fabric.kind == "stripes":
        share = band(v, 0.055 * s, 0.25 + 0.4 * trait(fabric, 2), soft)
        if trait(fabric, 3) < 0.45:  # a third colour in every other gap
            line = band(v + 0.0275 * s, 0.055 * s * (1 + (trait(fabric, 4) < 0.5)), 0.12, soft)
            color = mixed(mixed(first, second, share), palette(fabric, 0), line)
    elif fabric.kind == "fine stripes":
        share = band(u, 0.016 * s, 0.38, 0.0008)
    elif fabric.kind == "pinstripe":
        share = 0.55 * band(u, 0.022 * s, 0.07, 0.0008)
    elif fabric.kind == "check":
        period = 0.06 * s
        share = 0.5 * band(u, period, 0.45, soft) + 0.5 * band(v, period, 0.45, soft)
        if trait(fabric, 2) < 0.6:  # tartan
            line = 0.6 * np.maximum(
                band(u + 0.3 * period, period, 0.07, soft), band(v + 0.3 * period, period, 0.07, soft)
            )
            color = mixed(mixed(first, second, share), palette(fabric, 0), line)
    elif fabric.kind == "print":
        color = printed(fabric, u, v, offset)
    elif fabric.kind == "logo":
        color = emblem(fabric, name, u, v, soft)
    elif fabric.kind == "melange":
        share = 0.22 + 0.055 * grain(u, v, 0.0025, 0.009, texel, seed + 1, offset)
        second = 0.5 * (second + 0.5)
    elif fabric.kind == "tweed":
        fleck = grain(u, v, 0.0026, 0.0026, texel, seed + 1, offset)
        share = 0.30 + 0.15 * np.clip(fleck, -1.4, 1.6) + 0.12 * band(u + v, 0.012, 0.5, soft)
        second = 0.5 * (first + second)
    elif fabric.kind == "knit":
        period = 0.006 * (0.8 + 0.8 * trait(fabric, 2))
        column = np.abs((u / period) % 1 - 0.5)
        kept = 1 / (1 + (1.5 * texel / period) ** 4)  # stitches finer than two texels are grey
        stitch = np.clip(band(v + 0.7 * period * column, period, 0.35, 0.002) + 0.6 * (column < 0.08), 0, 1)
        share = 0.35 * (0.4 + kept * (stitch - 0.4))
        if trait(fabric, 3) < 0.4:  # ribs
            share = share + 0.22 * band(u, 0.012 + 0.012 * trait(fabric, 4), 0.4, 0.003)
        second = 0.45 * first
    elif fabric.kind == "corduroy":
        share = 0.42 * band(u, 0.0045 + 0.003 * trait(fabric, 2), 0.45, max(0.0020, texel))
        second = 0.45 * first
    elif fabric.kind == "denim":
        twill = band(u + 0.6 * v, 0.0035, 0.5, max(0.0015, texel))
        streak = grain(u, v, 0.0016, 0.030, texel, seed + 3, offset)
        slub = grain(u, v, 0.004, 0.09, texel, seed + 4, offset)
        share = 0.05 * twill + 0.16 + (0.06 + 0.06 * trait(fabric, 2)) * streak + 0.03 * slub
        second = 0.5 * first + 0.5 * np.array([0.48, 0.53, 0.60])
    elif fabric.kind == "leather":
        pore = grain(u, v, 0.003, 0.003, texel, seed, offset)
        scuff = np.clip(grain(u, v, 0.03, 0.045, texel, seed + 1, offset), 0, 2) ** 2
        share = 0.15 + 0.07 * pore + 0.05 * scuff
        second = 2.2 * first
    if color is None:
        color = mixed(first, second, np.clip(share, 0, 1))
    return np.clip(color * np.exp(irregular(fabric, u, v, offset, texel))[..., None], 0.008, 0.88)


def mixed(ground: np.ndarray, pattern: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolates colours (...,3) from `ground` to `pattern`, each (3,) or (...,3), by a share (...)."""
    return ground + (pattern - ground) * share[..., None]


def printed(fabric: Fabric, u: np.ndarray, v: np.ndarray, offset: float) -> np.ndarray:
    """Returns an all-over print (...,3): dots, flowers or leaves in one or two colours, camouflage, or tie-dye."""
    first, second, seed = np.array(fabric.first), np.array(fabric.second), fabric.seed
    kind, size = int(trait(fabric, 2) * 8), fabric.size * (0.5 + 1.2 * trait(fabric, 3) ** 2)
    if kind == 6:
        patch = [
            0.6 * noise(u / (0.07 * size) + offset, v / (0.05 * size), seed + k)
            + 0.4 * noise(u / (0.026 * size) + offset, v / (0.02 * size), seed + 10 + k)
            for k in range(3)
        ]
        color = np.broadcast_to(first, (*u.shape, 3))
        for field, share in zip(patch, (0.6, 1.0, 0.35)):
            target = first + (second - first) * share if share > 0.4 else 0.4 * first
            color = mixed(color, target, np.clip((field - 0.55) / 0.03, 0, 1))
        return color
    if kind == 7:
        field = noise(u / 0.12 + offset, v / 0.09, seed) + 0.5 * noise(u / 0.035 + offset, v / 0.03, seed + 1)
        rings = 0.5 + 0.5 * np.sin(9 * field)
        return mixed(mixed(first, second, rings), palette(fabric, 0), np.clip(2.5 * field - 2.2, 0, 0.8))
    cell = 0.055 * size
    color = mixed(first, second, motif(kind % 3, u + offset, v, cell, seed))
    if kind >= 3:
        small = motif((kind + 1) % 3, u + offset + 0.37 * cell, v + 0.45 * cell, 0.61 * cell, seed + 50)
        color = mixed(color, palette(fabric, 0), 0.9 * np.clip(small, 0, 1))
    return color


GLYPHS = (31599, 29847, 29671, 31143, 29391, 4687, 31567, 23533, 29847, 24914, 23469, 29257, 23421, 23533, 31599)


def lettering(x: np.ndarray, y: np.ndarray, seed: int, count: int) -> np.ndarray:
    """Returns the coverage (...) of a line of `count` block letters, each a unit square, centred at the origin."""
    x = x + count / 2
    at = np.floor(x)
    glyph = np.array(GLYPHS)[(lattice(at, 0 * at, seed) * len(GLYPHS)).astype(int)]
    column, row = np.floor((x - at) * 4), np.floor((0.5 - y) * 5)
    inside = (column < 3) & (row >= 0) & (row < 5) & (at >= 0) & (at < count)
    bit = np.clip(row * 3 + column, 0, 14).astype(int)
    return (inside & (np.right_shift(glyph, bit) & 1 == 1)).astype(float)


def emblem(fabric: Fabric, name: str, u: np.ndarray, v: np.ndarray, soft: float) -> np.ndarray:
    """Returns a plain ground (...,3) with a print on the chest, large or small, or on the back, or on the sleeves."""
    first, second, third = np.array(fabric.first), np.array(fabric.second), palette(fabric, 0)
    color = np.broadcast_to(first, (*np.broadcast(u, v).shape, 3))
    kind, place = int(trait(fabric, 2) * 9), trait(fabric, 3)
    if "sleeve" in name:
        if trait(fabric, 4) < 0.25:  # stripes down the sleeves
            color = mixed(color, second, band(u, 0.024, 0.45, soft) * (np.abs(u) < 0.036))
        return color
    if (name == "back") != (place > 0.85):
        return color
    small = 0.55 < place < 0.85
    reach = (0.032 if small else 0.075 + 0.07 * trait(fabric, 5)) * min(fabric.size, 1.3)
    x, y = (u - (0.085 if small else 0.0)) / reach, (v - (0.41 if small else 0.35)) / reach
    r, turn = np.hypot(x, y), np.arctan2(y, x)

    def cover(distance: np.ndarray) -> np.ndarray:
        return np.clip(0.5 - distance * reach / soft, 0, 1)

    if kind == 0:
        color = mixed(
            color,
            second,
            np.maximum(cover(np.abs(r - 0.85) - 0.15), cover(np.maximum(np.abs(x) - 0.45, np.abs(y) - 0.14))),
        )
    elif kind == 1:
        color = mixed(color, second, cover(np.abs(np.abs(y) + 1.2 * np.abs(x) - 0.68) - 0.22))
    elif kind == 2:
        color = mixed(color, second, band(v, 0.03, 0.5, soft) * cover(np.maximum(np.abs(x) - 1.3, np.abs(y) - 0.8)))
    elif kind in (3, 4):
        count = 4 + int(5 * trait(fabric, 6))
        color = mixed(color, second, lettering(x * 0.5 * count / 1.2, y * 1.6, fabric.seed, count))
        if kind == 4:
            low = lettering(x * 0.5 * 14 / 1.2, (y + 0.55) * 5.5, fabric.seed + 1, 14)
            color = mixed(color, third, low)
    elif kind == 5:  # a number
        color = mixed(color, second, lettering(x * 0.9, y * 0.55, fabric.seed, 2))
    elif kind == 6:
        star = cover(r - 0.55 - 0.4 * np.cos(5 * (turn - np.pi / 2)))
        color = mixed(mixed(color, third, cover(r - 1.1)), second, star)
    elif kind == 7:  # a picture: sun, hills and lines in a box
        inside = cover(np.maximum(np.abs(x), np.abs(y)) - 1)
        hill = cover(y + 0.25 + 0.5 * (noise(x * 1.7 + 9, 0 * x, fabric.seed) - 0.5))
        picture = mixed(np.broadcast_to(second, color.shape), palette(fabric, 1), np.clip(0.5 + 0.5 * y, 0, 1))
        picture = mixed(mixed(picture, third, cover(np.hypot(x - 0.2, y - 0.3) - 0.35)), 0.4 * third, hill)
        color = mixed(color, picture, inside)
    else:  # a band across the chest
        color = mixed(color, second, cover(np.abs(y) - 0.5))
        color = mixed(color, third, cover(np.abs(np.abs(y) - 0.72) - 0.07))
    return color
