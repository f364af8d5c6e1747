"""The sRGB transfer curve (IEC 61966-2-1), between linear values and codes of 0 to 1.

Only `encode` clips: a code outside [0,1] cannot be shown, while the linear value of a code above 1 is wanted where a
network's coded albedo is lit. Floats keep their type.
"""

import numpy as np


def encode(linear: np.ndarray) -> np.ndarray:
    """Codes in [0,1] of linear values, which are clipped to [0,1]; any shape."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def decode(code: np.ndarray) -> np.ndarray:
    """Linear values of codes in [0,1]; any shape. Beyond, the curve goes on: straight below 0, its power above 1."""
    return np.where(code <= 0.04045, code / 12.92, ((np.maximum(code, 0.04045) + 0.055) / 1.055) ** 2.4)


def to_bytes(code: np.ndarray) -> np.ndarray:
    """Codes as uint8, clipped to [0,1] and rounded."""
    return (np.clip(code, 0, 1) * 255).round().astype(np.uint8)


LINEAR = decode(np.arange(256) / 255).astype(np.float32)  # linear value of each 8-bit code
