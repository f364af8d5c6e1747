"""Relighting in spherical harmonics: shading under a light, the two ways to put it on a photo, and exposure."""

import numpy as np

from relight.panoramas import luminance
from relight.sh import order_of, rotate_y

ANGLES = 72  # every 5 degrees: a light of order 2 is smooth, the largest value is met to 0.2 %
FLOOR = 0.1  # of the mean old shading: under it the old shading is not trusted to divide by


def shading(transport: np.ndarray, light: np.ndarray) -> np.ndarray:
    """max(0, T.L): transport (...,K), light (K,3) -> irradiance (...,3) float32 (paper, equation 4).

    A light of lower order than the transport uses the lower bands of both. The series may ring below 0: clipped here.
    """
    count = min(transport.shape[-1], len(light))
    return np.maximum(transport[..., :count] @ light[:count].astype(np.float32), 0)


def floor_of(old: np.ndarray, mask: np.ndarray) -> float:
    """The least shading to divide by: FLOOR of the mean of `old` (S,S,3) over the figure."""
    return max(FLOOR * float(old[mask].mean()), 1e-4)


def ratio(old: np.ndarray, new: np.ndarray, floor: float) -> np.ndarray:
    """What to multiply the photo by: new / old shading, both held above `floor`; exactly 1 where they are equal."""
    return np.maximum(new, floor) / np.maximum(old, floor)


def brightest(transport: np.ndarray, light: np.ndarray) -> float:
    """The luminance of T.L for one transport vector (K,), at the angle where `light` (K,3), turned about the vertical,
    makes it largest.
    """
    count = min(len(transport), len(light))
    grey = luminance(light.astype(np.float64))[:, None]
    waves = 2 * order_of(count) + 1  # of the angle it is a sum of so many sines and cosines: as many samples tell all
    samples = [transport[:count] @ rotate_y(grey, 2 * np.pi * k / waves)[:count, 0] for k in range(waves)]
    weights = np.fft.rfft(samples) / waves
    angles = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    phases = np.exp(1j * np.outer(angles, np.arange(len(weights))))
    return float((phases * weights * np.where(np.arange(len(weights)), 2, 1)).sum(1).real.max())


def matched(old: np.ndarray, new: np.ndarray, transport: np.ndarray, mask: np.ndarray) -> float:
    """The factor for light `new` (K,3) that gives the figure the brightness it has under `old`.

    Brightness is the mean luminance of the figure's shading at the turn of the light where it is largest. So the
    exposure does not change while a light turns, a light matched to itself is 1, and none overexposes the figure more
    than the photo's own could.
    """
    mean = transport[mask].mean(0).astype(np.float64)
    had, has = brightest(mean, old), brightest(mean, new)
    return had / has if has > 1e-6 and had > 1e-6 else 1.0
