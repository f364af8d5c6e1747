"""Shading under a light, the gain from one light to another, and the exposure of a new light."""

import numpy as np

from relight.panoramas import luminance
from relight.sh import UNOCCLUDED_T00, rotate_y

ANGLES = 72  # headings, every 5 degrees: at order 2 the largest value is met to 0.2 %
FLOOR = 0.1  # of the mean shading: darker shading is too uncertain to divide by
CHANNEL = 0.6  # of the largest channel of a light's mean color: that of a warm lamp (#ffc890) has a luminance of .65
DARK = 0.15  # of the mean irradiance: the hue of darker shading is the light's, and that of twice as much its own


def shade(transport: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Returns the irradiance max(0, T . L) (the paper, equation 7).

    Args:
        transport: (...,P,K).
        light: (...,K,3) radiance coefficients; if the orders differ, the lower bands of both count.

    Returns:
        (...,P,3), of the type of the transport. A truncated series can be negative; it is clipped at 0.
    """
    count = min(transport.shape[-1], light.shape[-2])
    return np.maximum(transport[..., :count] @ light[..., :count, :].astype(transport.dtype, copy=False), 0)


def shading_floor(old: np.ndarray, mask: np.ndarray) -> float:
    """Returns the least shading to divide by: FLOOR of the mean of `old` (S,S,3) over `mask` (S,S)."""
    return max(FLOOR * float(old[mask].mean()), 1e-4)


def steady(shading: np.ndarray, light: np.ndarray, floor: float = 0.0) -> np.ndarray:
    """Gives dark shading the color of its light as a whole, at the luminance that it has, but at least `floor`.

    The channels of dark shading are small differences of large terms. What is left of them has any hue, and what is
    clipped has the complementary one: under a warm lamp a shaded cheek would be navy.

    Args:
        shading: (...,3).
        light: (K,3) that it is of.
        floor: luminance.

    Returns:
        (...,3) float32, not negative; brighter shading as it is.
    """
    mean = np.maximum(light[0], 0).astype(np.float32)
    brightness = max(float(luminance(mean)), 1e-6)
    known, level = np.maximum(shading, 0), luminance(shading).astype(np.float32)[..., None]
    share = np.clip(2 - level / np.float32(max(DARK * UNOCCLUDED_T00 * brightness, floor, 1e-6)), 0, 1)
    return known + share * (np.maximum(level, np.float32(floor)) * (mean / np.float32(brightness)) - known)


def gain(transport: np.ndarray, mask: np.ndarray, light: np.ndarray, new_light: np.ndarray) -> np.ndarray:
    """Returns the gain (S,S,3) of mode `ratio`: `gain_between` the shadings of both lights.

    Args:
        transport: (S,S,K).
        mask: (S,S) bool.
        light: (K,3) of the photo.
        new_light: (K,3).
    """
    return gain_between(shade(transport, light), shade(transport, new_light), mask, light, new_light)


def gain_between(
    first: np.ndarray, second: np.ndarray, mask: np.ndarray, light: np.ndarray, new_light: np.ndarray
) -> np.ndarray:
    """Returns new / old shading, both `steady`; 1 where they are equal.

    What a channel of the old shading lacks of the floor is added to both.

    Args:
        first, second: (S,S,3), the old and the new shading.
        mask: (S,S) bool.
        light, new_light: (K,3) that they are of.

    Returns:
        (S,S,3) float32.
    """
    floor = shading_floor(first, mask)
    old, new = steady(first, light, floor), steady(second, new_light, floor)
    lacking = np.maximum(np.float32(floor) - old, 0)
    return (new + lacking) / (old + lacking)


def max_luminance(transport: np.ndarray, light: np.ndarray) -> float:
    """Returns the largest luminance of T . L, of one transport (K,), over all headings of a light (K,3)."""
    count = min(len(transport), len(light))
    grey = luminance(light.astype(np.float64))[:, None]
    turned = (rotate_y(grey, 2 * np.pi * n / ANGLES)[:count, 0] for n in range(ANGLES))
    return max(float(transport[:count] @ light) for light in turned)


def saturation(light: np.ndarray) -> float:
    """Returns the factor by which a light (K,3) counts as brighter than its luminance, if a channel would burn."""
    mean = np.maximum(light[0], 0)
    return max(1.0, CHANNEL * float(mean.max()) / max(float(luminance(mean)), 1e-9))


def exposure_factor(
    old: np.ndarray, new: np.ndarray, transport: np.ndarray, mask: np.ndarray, turning: bool = False
) -> float:
    """Returns the factor for a new light that keeps the brightness that a person has under the old one.

    Brightness is the mean luminance of the shading, or CHANNEL of the largest channel of a light of a deep color, which
    would burn skin. The factor of a light to itself is 1.

    Args:
        old: (K,3) the photo's light.
        new: (K,3) the light to be scaled.
        transport: (S,S,K) of the person.
        mask: (S,S) bool, the person's pixels.
        turning: whether the light turns: its brightness is then that at the heading where it is largest, so that the
            exposure does not change.
    """
    if turning:
        mean = transport[mask].mean(0).astype(np.float64)
        before, after = max_luminance(mean, old), max_luminance(mean, new)
    else:
        before, after = (float(luminance(shade(transport[mask], light)).mean()) for light in (old, new))
    before, after = before * saturation(old), after * saturation(new)
    return before / after if after > 1e-6 and before > 1e-6 else 1.0
