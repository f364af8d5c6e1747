"""Shading under a light, the gain from one light to another, and the exposure of a new light."""

import numpy as np

from relight.panoramas import luminance
from relight.sh import order_of, rotate_y

ANGLES = 72  # headings, every 5 degrees: at order 2 the largest value is met to 0.2 %
FLOOR = 0.1  # of the mean shading: darker shading is too uncertain to divide by
HUE_NOISE = 0.1  # floors: the hue of darker shading is unknown
HUE_FLOOR = 3  # floors: the hue of darker shading is too uncertain to divide by


def shading(transport: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Returns the irradiance max(0, T . L) (paper, equation 4).

    Args:
        transport: (...,K).
        light: (K,3) radiance coefficients; if the orders differ, the lower bands of both count.

    Returns:
        (...,3) float32. A truncated series can be negative; it is clipped at 0.
    """
    count = min(transport.shape[-1], len(light))
    return np.maximum(transport[..., :count] @ light[:count].astype(np.float32), 0)


def shading_floor(old: np.ndarray, mask: np.ndarray) -> float:
    """Returns the least shading to divide by: FLOOR of the mean of `old` (S,S,3) over `mask` (S,S)."""
    return max(FLOOR * float(old[mask].mean()), 1e-4)


def raised(shading: np.ndarray, floor: float) -> np.ndarray:
    """Raises dark shading (...,3) so that its largest channel is at least `floor`, with its hue kept.

    Where there is hardly any light, its hue fades to white.
    """
    light = np.maximum(shading, 0)
    peak = light.max(-1, keepdims=True)
    grey = HUE_NOISE * floor
    return light + np.maximum(floor - peak, 0) * (light + grey) / (peak + grey)


def shading_ratio(old: np.ndarray, new: np.ndarray, floor: float) -> np.ndarray:
    """Returns the gain of mode `ratio`: new / old shading (...,3), both `raised`; 1 where they are equal.

    The channels of dark shading are small differences of large terms: their errors have hues, and a ratio would
    multiply them. What a channel lacks of the largest one, up to HUE_FLOOR floors, is added to both shadings.
    """
    least = raised(old, floor)
    lacking = np.maximum(np.minimum(least.max(-1, keepdims=True), HUE_FLOOR * floor) - least, 0)
    return (raised(new, floor) + lacking) / (least + lacking)


def max_luminance(transport: np.ndarray, light: np.ndarray) -> float:
    """Returns the largest luminance of T . L over all headings of a light.

    Args:
        transport: one vector (K,).
        light: (K,3), rotated about the vertical axis.
    """
    count = min(len(transport), len(light))
    grey = luminance(light.astype(np.float64))[:, None]
    waves = 2 * order_of(count) + 1  # a trigonometric polynomial of the angle: as many samples determine it
    samples = [transport[:count] @ rotate_y(grey, 2 * np.pi * k / waves)[:count, 0] for k in range(waves)]
    weights = np.fft.rfft(samples) / waves
    angles = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    phases = np.exp(1j * np.outer(angles, np.arange(len(weights))))
    return float((phases * weights * np.where(np.arange(len(weights)), 2, 1)).sum(1).real.max())


def exposure_factor(old: np.ndarray, new: np.ndarray, transport: np.ndarray, mask: np.ndarray) -> float:
    """Returns the factor for a new light that keeps the brightness that a person has under the old one.

    Brightness is the mean luminance of the shading at the heading of the light where it is largest. So the exposure
    does not change while a light turns, and the factor of a light to itself is 1.

    Args:
        old: (K,3) the photo's light.
        new: (K,3).
        transport: (S,S,K).
        mask: (S,S) bool.
    """
    mean = transport[mask].mean(0).astype(np.float64)
    before, after = max_luminance(mean, old), max_luminance(mean, new)
    return before / after if after > 1e-6 and before > 1e-6 else 1.0
