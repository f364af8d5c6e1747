"""The sRGB transfer function (IEC 61966-2-1) between linear values and codes, both in [0,1].

Only `encode` clips, since codes outside [0,1] cannot be displayed; linear values of codes above 1 are needed to relight
a network's coded albedo. Floats keep their type.
"""

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec. 709


def encode(linear: np.ndarray) -> np.ndarray:
    """Returns the sRGB codes in [0,1] (IEC 61966-2-1) of linear values of any shape, which are clipped to [0,1]."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def decode(code: np.ndarray) -> np.ndarray:
    """Returns the linear values of sRGB codes (IEC 61966-2-1) of any shape, extrapolated beyond [0,1]."""
    return np.where(code <= 0.04045, code / 12.92, ((np.maximum(code, 0.04045) + 0.055) / 1.055) ** 2.4)


def to_bytes(code: np.ndarray) -> np.ndarray:
    """Returns codes as uint8, clipped to [0,1] and rounded."""
    return (np.clip(code, 0, 1) * 255).round().astype(np.uint8)


def to_linear(pixels: np.ndarray) -> np.ndarray:
    """Returns the linear float32 values of uint8 or uint16 codes; of floats, which are linear already, themselves."""
    if pixels.dtype.kind == "f":
        return pixels
    return LINEAR[pixels] if pixels.dtype == np.uint8 else LINEAR_16[pixels]


LINEAR = decode(np.arange(256) / 255).astype(np.float32)  # linear value of each 8-bit code
LINEAR_16 = decode(np.arange(65536) / 65535).astype(np.float32)  # and of each 16-bit code
