"""Colours of lamps and of light."""

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec. 709
# Linear Rec. 709 of black bodies, and of daylight above 6500 K.
KELVIN = np.array([2200, 2700, 3000, 3500, 4000, 5000, 6000, 7000, 9000, 12000], float)
TINT = np.array(
    [
        [1.0, 0.44, 0.08],
        [1.0, 0.57, 0.22],
        [1.0, 0.63, 0.30],
        [1.0, 0.71, 0.42],
        [1.0, 0.78, 0.54],
        [1.0, 0.90, 0.77],
        [1.0, 0.97, 0.95],
        [0.93, 0.96, 1.06],
        [0.80, 0.90, 1.15],
        [0.70, 0.85, 1.22],
    ]
)


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Relative luminance of linear Rec. 709 (..., 3)."""
    return rgb @ LUMINANCE


def kelvin(temperature: float) -> np.ndarray:
    """Linear RGB (3,) of a light of this colour temperature, of luminance 1."""
    colour = np.array([np.interp(temperature, KELVIN, TINT[:, c]) for c in range(3)])
    return colour / luminance(colour)
