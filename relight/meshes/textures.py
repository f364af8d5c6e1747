"""Textures and colours: pictures stay 8-bit sRGB, colours per vertex become linear."""

import io
import warnings
from pathlib import Path

import numpy as np

from relight.files import UserError
from relight.srgb import LINEAR, decode


def linear(srgb: np.ndarray) -> np.ndarray:
    """sRGB-coded values as linear float32: uint8 of 0..255, or floats, clipped to 0..1; any shape."""
    if srgb.dtype == np.uint8:
        return LINEAR[srgb]
    return decode(np.clip(srgb, 0, 1)).astype(np.float32)


def read_texture(source: Path | bytes, what: str) -> np.ndarray:
    """A picture file, or its bytes, as (H,W,3) uint8 sRGB, row 0 at the top; alpha is dropped, 16 bits become 8.

    Raises UserError, which names `what`, on anything but a whole picture of at most 178 million pixels (Pillow's bound
    for decompression bombs; 8192 x 8192 has 67).
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # it comes at half the bound
            image = Image.open(source if isinstance(source, Path) else io.BytesIO(source))
        with image:
            if image.mode.startswith("I"):  # Pillow clips 16-bit grey to 8 bits instead of scaling it
                grey = np.clip(np.asarray(image).astype(np.int64) // 256, 0, 255).astype(np.uint8)
                return np.repeat(grey[..., None], 3, axis=-1)
            return np.ascontiguousarray(np.asarray(image.convert("RGB")))
    except UnidentifiedImageError:
        raise UserError(f"{what} is not a picture; PNG, JPEG, TIFF, TGA, BMP and WebP are read") from None
    except Image.DecompressionBombError:
        raise UserError(f"{what} has more than 178 million pixels: scale it down") from None
    except Exception as error:  # Pillow's decoders raise a dozen types over damaged files
        reason = str(error).split("\n")[0] or type(error).__name__
        raise UserError(f"{what} cannot be read ({reason}): it is damaged") from None
