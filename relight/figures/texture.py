"""Procedural textures: noise that is the same on every machine, stripes, blends of colors, and 8-bit sRGB."""

import numpy as np

from relight.core.srgb import encode

Color = tuple[float, float, float]  # linear albedo of red, green and blue
MIN_TEXELS = 1.4  # size of the smallest feature
NOISE_SCALE = 5.0  # factor that gives `noise`, less its mean, a standard deviation of about 1
SRGB = (255 * encode(np.arange(65536) / 65535) + 0.5).astype(np.uint8)  # by linear value


def as_color(values: np.ndarray) -> Color:
    """Returns an array (3,) as a tuple."""
    red, green, blue = values.tolist()
    return red, green, blue


def lattice(i: np.ndarray, j: np.ndarray, seed: int) -> np.ndarray:
    """Hashes integer lattice points (i, j), of equal shapes, to [0,1), the same on every machine.

    The points and the seed are mixed by products with large odd numbers and shifts, modulo 2^32 (as in xxHash); 24 bits
    of the result are used.
    """
    with np.errstate(over="ignore"):
        i, j = (points.astype(np.int64).astype(np.uint32) for points in (i, j))
        h = i * np.uint32(374761393) + j * np.uint32(668265263)
        h = (h ^ np.uint32((seed * 2246822519) & 0xFFFFFFFF)) * np.uint32(3266489917)
        h = (h ^ (h >> np.uint32(15))) * np.uint32(2654435761)
    return ((h ^ (h >> np.uint32(13))) & np.uint32(0xFFFFFF)).astype(np.float64) / 2**24


def lattice_value(i: int, j: int, seed: int) -> float:
    """Returns the random number in [0,1) that `lattice` has at one point (i, j)."""
    return float(lattice(np.array(i), np.array(j), seed))


def random_numbers(count: int, columns: int, seed: int) -> np.ndarray:
    """Returns random numbers in [0,1), (count,columns), the same on every machine."""
    return np.stack([lattice(np.arange(count), np.full(count, k), seed) for k in range(columns)], -1)


def noise(x: np.ndarray, y: np.ndarray, seed: int = 0) -> np.ndarray:
    """Returns value noise in [0,1] with features of size 1: random values at integers, smoothly interpolated.

    Args:
        x, y: (...) coordinates.
        seed: random seed of the values.
    """
    i, j = np.floor(x), np.floor(y)
    a, b = smoothstep(x - i), smoothstep(y - j)
    low = lattice(i, j, seed) * (1 - a) + lattice(i + 1, j, seed) * a
    high = lattice(i, j + 1, seed) * (1 - a) + lattice(i + 1, j + 1, seed) * a
    return low * (1 - b) + high * b


def smoothstep(t: np.ndarray) -> np.ndarray:
    """Returns 3 t^2 - 2 t^3, which rises from 0 to 1 over [0,1] with slope 0 at both ends."""
    return t * t * (3 - 2 * t)


def grain(
    u: np.ndarray, v: np.ndarray, width: float, height: float, texel: float, seed: int, offset: float = 0.0
) -> np.ndarray:
    """Returns noise (...) of mean 0 and standard deviation about 1 with features of `width` by `height` metres.

    Features finer than MIN_TEXELS texels are enlarged, with the lower contrast of averages of independent ones.

    Args:
        u, v: (...) cloth coordinates, metres.
        width, height: of the features along u and v, metres.
        texel: metres between the samples.
        seed: random seed of the noise.
        offset: in features along u, which makes the noise of panels differ.
    """
    smallest = MIN_TEXELS * texel
    drawn_width, drawn_height = max(width, smallest), max(height, smallest)
    contrast = float(np.sqrt(width / drawn_width * height / drawn_height))
    return contrast * NOISE_SCALE * (noise(u / drawn_width + offset, v / drawn_height, seed) - 0.5)


def band(x: np.ndarray, period: float, share: float, soft: float = 0.0012) -> np.ndarray:
    """Returns 1 inside stripes and 0 between them (...).

    Args:
        x: (...) coordinate across the stripes, metres; one of them has its middle at 0.
        period: metres from one stripe to the next.
        share: share of each period that a stripe fills.
        soft: metres over which edges rise.
    """
    from_middle = np.abs((x / period + 0.5) % 1 - 0.5) * period  # metres
    return np.clip((share * period / 2 - from_middle) / soft + 0.5, 0, 1)


def mixed(ground: np.ndarray, pattern: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolates colors (...,3) from `ground` to `pattern`, each (3,) or (...,3), by a share (...)."""
    return ground + (pattern - ground) * share[..., None]


def coded(linear: np.ndarray) -> np.ndarray:
    """Returns linear values (...), clipped to [0,1], as 8-bit sRGB, by a table of 65536 values."""
    return SRGB[(65535 * np.clip(linear, 0, 1) + 0.5).astype(np.uint16)]
