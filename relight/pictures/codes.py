"""Between linear light and the codes of a picture, of 8 or 16 bits, with and without alpha."""

import numpy as np

from relight.core.srgb import decode, encode

# The code of a linear value is found by a search among the 255 values half-way between two codes: faster than the power
# function, and exactly the inverse of LINEAR.
_EDGES = decode((np.arange(255) + 0.5) / 255).astype(np.float32)
_TOP = float(_EDGES[-1]) * 1.0001
_STEPS = 1 << 15  # cells of the lookup table; a cell above 0.001 holds at most one edge, so one comparison is enough
# The code at the lower end of each cell, which is even in the root of the value, since codes are denser in the dark.
_CELLS = np.searchsorted(_EDGES, (np.arange(_STEPS + 1) / _STEPS) ** 2 * _TOP, side="right").astype(np.uint8)
_PADDED = np.append(_EDGES, np.float32(np.inf))  # the least value of the code after each code


def to_codes(linear: np.ndarray, type: np.dtype | type) -> np.ndarray:
    """Encodes linear values of any shape as sRGB of a type, uint8 or uint16; floats stay linear."""
    if np.dtype(type).kind == "f":
        return np.asarray(linear, type)
    if type == np.uint8:
        return to_srgb8(linear)
    return np.round(encode(np.nan_to_num(linear).astype(np.float64)) * 65535).astype(np.uint16)


def to_srgb8(linear: np.ndarray) -> np.ndarray:
    """Encodes linear values of any shape as 8-bit sRGB, clipped; NaN becomes 0. The inverse of LINEAR."""
    values = np.fmax(np.asarray(linear, np.float32), np.float32(0))
    cell = np.sqrt(np.minimum(values, np.float32(_TOP)) * np.float32((_STEPS - 1) ** 2 / _TOP)).astype(np.int16)
    low = _CELLS[cell]
    return low + (values >= _PADDED[low])


def as_codes(pixels: np.ndarray) -> np.ndarray:
    """Returns uint8 sRGB, uint16 sRGB or linear floats, as `Picture` has them, as uint8 sRGB."""
    if pixels.dtype == np.uint8:
        return pixels
    return to_srgb8(pixels) if pixels.dtype.kind == "f" else np.round(pixels / np.float32(257)).astype(np.uint8)


def convert_alpha(alpha: np.ndarray, dtype: np.dtype | type) -> np.ndarray:
    """Returns alpha of any shape, uint8, uint16 or float32, as another of these types: 255 is 65535 or 1.0."""
    dtype = np.dtype(dtype)
    if alpha.dtype == dtype:
        return alpha
    opaque = {1: 255, 2: 65535, 4: 1}  # by bytes
    values = alpha / np.float32(opaque[alpha.itemsize]) * np.float32(opaque[dtype.itemsize])
    return (values if dtype.kind == "f" else np.round(values)).astype(dtype)


def with_alpha(pixels: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Returns pixels (H,W,3) with alpha (H,W) of any type as a fourth channel, of their type."""
    return np.dstack([pixels, convert_alpha(alpha, pixels.dtype)])


def on_white(pixels: np.ndarray) -> np.ndarray:
    """Returns pixels (H,W,3) or (H,W,4) as (H,W,3) uint8 sRGB, white where they are transparent."""
    codes = as_codes(pixels[..., :3])
    if pixels.shape[2] == 3:
        return codes
    return np.round(255 + convert_alpha(pixels[..., 3:], np.float32) * (codes - np.float32(255))).astype(np.uint8)
