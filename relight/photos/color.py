"""Colour between a photo's bytes and light, and back, exactly.

A photo's linear values are light up to where the camera clipped it. Relighting multiplies them. What grows beyond
white is rolled off by its brightest channel, with its hue kept; what shrinks stays as it is; a factor of 1 returns
every one of the 2^24 colours: `to_srgb8(relit(LINEAR[v], 1)) == v`. A channel that was clipped is rebuilt from the
others, as far as the factor is below 1.
"""

import numpy as np
from scipy.ndimage import uniform_filter

from relight.srgb import LINEAR, decode

KNEE = 0.8  # linear value under which nothing is rolled off
FADE = 0.06  # how fast a colour that is rolled off pales, so that a lamp in it still shows as brightness
CLIPPING = float(LINEAR[235])  # from here to white a channel passes from measured to clipped
MOST = 0.6  # by which share a clipped channel is raised at most; below 1, so that brighter light is never darker
DISPLAY = -1  # stops at which a shading is shown: one of 1, in which white paper is just white, is code 188


def rolled(color: np.ndarray, white: np.ndarray | float = np.inf) -> np.ndarray:
    """Light (...,3) >= 0 -> linear values in [0,1], for light whose channels reach `white` (...), at least 1, at most.

    The brightest channel is kept up to KNEE and reaches 1 at `white`: t -> t / (1 + (1 - 1/w) t) above the knee, which
    is the straight line for w = 1 and Reinhard's curve for w = inf. The others keep their ratio to it and pale slowly,
    as in the Khronos "PBR Neutral" curve. Smooth, and monotone in the light's strength.
    """
    peak = np.maximum(np.maximum(color[..., 0], color[..., 1]), color[..., 2])
    above = np.maximum(peak - KNEE, 0) / (1 - KNEE)
    top = np.minimum(peak, KNEE) + (1 - KNEE) * above / (1 + (1 - (1 - KNEE) / (white - KNEE)) * above)
    fade = 1 - 1 / (1 + FADE * np.maximum(peak - top, 0))
    scale = (1 - fade) * top / np.maximum(peak, 1e-9)
    return color * scale[..., None] + (fade * top)[..., None]


def relit(linear: np.ndarray, gain: np.ndarray | float, excess: np.ndarray | float = 0.0) -> np.ndarray:
    """A photo's linear values (...,3) under `gain` (...,3) times the light, rolled off: linear values in [0,1].

    excess (...,3): by which share the light was above what the camera stored (`excess`); it counts as far as the gain
    is below 1, so that a gain of 1 returns `linear`.
    """
    gain = np.asarray(gain, np.float32)
    light = linear * gain
    if np.ndim(excess):
        light = light * (1 + excess * np.maximum(1 - gain, 0))
    if not (gain > 1).any():
        return light
    white = np.maximum(gain.max(-1) if gain.ndim else gain, 1)
    return rolled(light, white)


def shown(shading: np.ndarray) -> np.ndarray:
    """A shading (...,3) as linear values in [0,1]: DISPLAY stops, then rolled off, so that nothing is burnt out."""
    return rolled(np.asarray(shading) * np.float32(2.0**DISPLAY))


def chroma(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The colour (H,W,3), summing to 1, that bright things have about each pixel of `image` (H,W,3), linear.

    Only what is not clipped counts, and brighter things far more, so that dark hair beside a blown-out cheek does not
    tint it. Means over ever smaller squares, each filled in from the larger ones.
    """
    peak = image.max(-1)
    weight = mask * peak**4 * (1 - _ramp(peak))
    unit = image / np.maximum(image.sum(-1, keepdims=True), 1e-6)
    found = np.full_like(image, 1 / 3)
    for width in (2 * len(image), len(image) // 4, len(image) // 16, len(image) // 64):
        size = max(width | 1, 3)
        total = uniform_filter(weight, size, mode="constant")[..., None]
        means = uniform_filter(unit * weight[..., None], (size, size, 1), mode="constant")
        found = (np.maximum(means, 0) + 3e-3 * found) / (np.maximum(total, 0) + 3e-3)
    return found.astype(np.float32)


def excess(linear: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """By which share (...,3), in [0, MOST), the light was above the `linear` values (...,3) where these are clipped.

    The channels that are not clipped say how much light there was, and `colors` (`chroma`) what colour it had. Where
    all are clipped the colour's least channel is taken to be just white.
    """
    clipped = _ramp(linear)
    kept = (1 - clipped) * colors
    least = 2e-2 * (linear / np.maximum(colors, 1e-3)).max(-1, keepdims=True)
    amount = ((kept * linear).sum(-1, keepdims=True) + least) / ((kept * colors).sum(-1, keepdims=True) + 2e-2)
    above = np.maximum(colors * amount / np.maximum(linear, 1e-3) - 1, 0)
    return (clipped * MOST * (1 - np.exp(-above / MOST))).astype(np.float32)


def _ramp(linear: np.ndarray) -> np.ndarray:
    t = np.clip((linear - CLIPPING) / (1 - CLIPPING), 0, 1)
    return t * t * (3 - 2 * t)


# Finding the code of a linear value is a search among the 255 values half-way between two codes: faster than the power
# function, and exactly the inverse of the table.
_EDGES = decode((np.arange(255) + 0.5) / 255).astype(np.float32)
_TOP = float(_EDGES[-1]) * 1.0001
_STEPS = 1 << 15  # cells of the lookup table; a cell holds at most one edge above 0.001, so one comparison settles it
_CELLS = np.searchsorted(_EDGES, (np.arange(_STEPS + 1) / _STEPS) ** 2 * _TOP, side="right").astype(np.uint8)
_PADDED = np.append(_EDGES, np.float32(np.inf))


def to_srgb8(linear: np.ndarray) -> np.ndarray:
    """Linear values -> 8-bit sRGB, clipped; the inverse of LINEAR. By a table over sqrt(value) and one comparison."""
    values = np.fmax(np.asarray(linear, np.float32), np.float32(0))  # fmax: what is not a number is 0
    cell = np.sqrt(np.minimum(values, np.float32(_TOP)) * np.float32((_STEPS - 1) ** 2 / _TOP)).astype(np.int16)
    low = _CELLS[cell]
    return low + (values >= _PADDED[low])
