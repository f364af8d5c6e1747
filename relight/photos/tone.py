"""From a photo's bytes to linear light, relit, and back to bytes.

Linear values are proportional to light up to where the camera clipped them. Relighting multiplies them. Values above
white are rolled off by their largest channel, with their hue kept; lower values stay as they are. A gain of 1 returns
all 2^24 colors: `to_srgb8(apply_gain(LINEAR[v], 1)) == v`. A clipped channel is rebuilt from the other channels, as
far as the gain is below 1; near black, where values are noise, large gains count less.
"""

import numpy as np
from scipy.ndimage import uniform_filter

from relight.core.srgb import LINEAR

KNEE = 0.8  # linear value from which values are rolled off
FADE = 0.06  # how fast a rolled-off color pales, so that a strong lamp still shows as brightness
CLIPPING = float(LINEAR[235])  # from here to white a channel passes from measured to clipped
NOISE = 1e-3  # linear value (code 3) of the noise of sensors and coders
BLACK_GAIN = 2.0  # what a gain adds to 1 at most where there is nothing but noise
PRIOR = 3e-3  # weight of the color of larger squares, against the mean weight of the pixels in a smaller one
MAX_EXCESS = 0.6  # share by which a clipped channel is raised at most; below 1, so more light is never darker
DISPLAY_STOPS = -1  # at which a shading is displayed: 1, the shading of just white paper, becomes code 188


def roll_off(color: np.ndarray, white: np.ndarray | float = np.inf) -> np.ndarray:
    """Compresses linear values into [0,1] with their hue kept.

    The largest channel is kept up to KNEE and reaches 1 at `white`: t -> t / (1 + (1 - 1/w) t) above the knee, which
    is a straight line for w = 1 and Reinhard's curve for w = inf. The others keep their ratio to it and pale slowly, as
    in the Khronos "PBR Neutral" tone mapper. The curve is smooth, and monotone in the strength of the light.

    Args:
        color: (...,3), at least 0.
        white: (...) the largest value of the channels, at least 1.

    Returns:
        (...,3) in [0,1].
    """
    peak = np.maximum(np.maximum(color[..., 0], color[..., 1]), color[..., 2])
    above = np.maximum(peak - KNEE, 0) / (1 - KNEE)
    top = np.minimum(peak, KNEE) + (1 - KNEE) * above / (1 + (1 - (1 - KNEE) / (white - KNEE)) * above)
    fade = 1 - 1 / (1 + FADE * np.maximum(peak - top, 0))
    scale = (1 - fade) * top / np.maximum(peak, 1e-9)
    return color * scale[..., None] + (fade * top)[..., None]


def apply_gain(linear: np.ndarray, gain: np.ndarray | float, excess: np.ndarray | float = 0.0) -> np.ndarray:
    """Multiplies a photo's values by a gain and rolls them off.

    Toward black large gains are limited, since they would turn noise into colored stipple: what a gain adds to 1, r,
    becomes r / (1 + r / c) = r - r^2 / (c + r), where c = BLACK_GAIN + (v / NOISE)^2 and v is the value of the largest
    channel.

    Args:
        linear: (...,3) the photo's values.
        gain: (...,3), new / old light.
        excess: (...,3) share by which the light was above a clipped value (`clipping_excess`). It counts as far as the
            gain is below 1, so a gain of 1 returns `linear`.

    Returns:
        (...,3) in [0,1].
    """
    factor: np.ndarray = np.asarray(gain, np.float32)
    brighter = (factor > 1).any()
    if brighter:
        peak = np.maximum(np.maximum(linear[..., 0], linear[..., 1]), linear[..., 2])[..., None]  # faster than max(-1)
        limit = BLACK_GAIN + (peak / np.float32(NOISE)) ** 2
        raised = np.maximum(factor - 1, 0)
        factor = factor - raised**2 / (limit + raised)
    light = linear * factor
    if np.ndim(excess):
        light = light * (1 + excess * np.maximum(1 - factor, 0))
    return roll_off(light, np.maximum(factor.max(-1), 1)) if brighter else light


def display_shading(shading: np.ndarray) -> np.ndarray:
    """Returns a shading (...,3) for display, linear in [0,1]: at DISPLAY_STOPS and rolled off, so nothing clips."""
    return roll_off(np.asarray(shading) * np.float32(2.0**DISPLAY_STOPS))


def chroma(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Estimates the color of bright surfaces around each pixel.

    Only unclipped values count, and bright ones far more, so that dark hair beside a clipped cheek does not tint it.
    Means over ever smaller squares, each completed by those of the larger ones.

    Args:
        image: (H,W,3) linear.
        mask: (H,W) bool.

    Returns:
        (H,W,3) float32; channels sum to 1.
    """
    peak = image.max(-1)
    weight = mask * peak**4 * (1 - _clipped(peak))
    unit = image / np.maximum(image.sum(-1, keepdims=True), 1e-6)
    colors = np.full_like(image, 1 / 3)
    for width in (2 * len(image), len(image) // 4, len(image) // 16, len(image) // 64):
        size = max(width | 1, 3)  # odd
        total = uniform_filter(weight, size, mode="constant")[..., None]
        means = uniform_filter(unit * weight[..., None], (size, size, 1), mode="constant")
        colors = (np.maximum(means, 0) + PRIOR * colors) / (np.maximum(total, 0) + PRIOR)
    return colors.astype(np.float32)


def clipping_excess(linear: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Estimates how far the light was above clipped values.

    The channels that are not clipped give the amount of light, `colors` its chromaticity. Where all are clipped, the
    smallest channel of the color is taken to be just white.

    Args:
        linear: (...,3) the photo's values.
        colors: (...,3) from `chroma`.

    Returns:
        (...,3) float32 share in [0, MAX_EXCESS); 0 where nothing is clipped.
    """
    clipped = _clipped(linear)
    measured = (1 - clipped) * colors
    ridge = 2e-2  # weight of the estimate where all channels are clipped, in the least squares of `amount`
    least = ridge * (linear / np.maximum(colors, 1e-3)).max(-1, keepdims=True)
    amount = ((measured * linear).sum(-1, keepdims=True) + least) / ((measured * colors).sum(-1, keepdims=True) + ridge)
    above = np.maximum(colors * amount / np.maximum(linear, 1e-3) - 1, 0)
    return (clipped * MAX_EXCESS * (1 - np.exp(-above / MAX_EXCESS))).astype(np.float32)


def _clipped(linear: np.ndarray) -> np.ndarray:
    """Returns how far values count as clipped, in [0,1]: a smooth step from CLIPPING to 1."""
    t = np.clip((linear - CLIPPING) / (1 - CLIPPING), 0, 1)
    return t * t * (3 - 2 * t)
