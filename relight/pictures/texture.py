"""Textures of meshes, from files or from bytes inside of them."""

import io
import warnings
from pathlib import Path

import numpy as np

from relight.core.errors import UserError


def read_texture(source: Path | bytes, what: str) -> np.ndarray:
    """Reads a picture; alpha is dropped, 16 bits become 8.

    Args:
        source: a file, or its bytes.
        what: names the picture in error messages.

    Returns:
        (H,W,3) uint8 sRGB, row 0 at the top.

    Raises:
        UserError: if it is not a whole picture of at most 178 million pixels (Pillow's bound for decompression bombs).
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of pictures of half the bound, and of palettes with alpha
            with Image.open(source if isinstance(source, Path) else io.BytesIO(source)) as image:
                if image.mode == "F":
                    raise UserError(f"{what} holds floating-point numbers: save it in 8 bits")
                if image.mode.startswith("I"):  # Pillow clips 16-bit grey to 8 bits instead of scaling it
                    grey = np.clip(np.asarray(image).astype(np.int64) // 256, 0, 255).astype(np.uint8)
                    return np.repeat(grey[..., None], 3, axis=-1)
                return np.ascontiguousarray(np.asarray(image.convert("RGB")))
    except UserError:
        raise
    except UnidentifiedImageError:
        raise UserError(f"{what} is not a picture; PNG, JPEG, TIFF, TGA, BMP and WebP are read") from None
    except Image.DecompressionBombError:
        raise UserError(f"{what} has more than 178 million pixels: scale it down") from None
    except PermissionError:
        raise UserError(f"{what} cannot be read: permission denied") from None
    except Exception as error:  # Pillow's decoders raise a dozen types over damaged files
        reason = str(error).split("\n")[0] or type(error).__name__
        raise UserError(f"{what} cannot be read ({reason}): it is damaged") from None
