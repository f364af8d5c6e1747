"""Textures of meshes, from files or from bytes inside of them."""

from pathlib import Path

import numpy as np

from relight.core.files import require_readable
from relight.pictures.codes import as_codes
from relight.pictures.opening import coding_of, decoding_errors, open_picture
from relight.pictures.picture import decoded
from relight.pictures.profile import to_srgb


def read_texture(source: Path | bytes, what: str, by_profile: bool = True) -> np.ndarray:
    """Reads a picture as it lies, whatever its orientation; alpha is dropped, 16 bits become 8.

    Args:
        source: a file, or its bytes.
        what: names the picture in error messages.
        by_profile: whether its color profile counts, as in photos; glTF 2.0 (3.8.2) ignores it.

    Returns:
        (H,W,3) uint8 sRGB, row 0 at the top.

    Raises:
        UserError: if it is not a whole picture, too large, animated, or has more than 16 bits.
    """
    file = source if isinstance(source, Path) else None
    if file:
        require_readable(file, what)
    with decoding_errors(what), open_picture(source, what, "PNG, JPEG, TIFF, TGA, BMP or WebP") as image:
        if image.mode == "CMYK":
            image = image.convert("RGB")
        pixels, _ = decoded(image, what, None)  # 8 bits are enough, and need no OpenImageIO
        if by_profile:
            pixels, _ = to_srgb(pixels, image, what, coding_of(image, file))
        return np.ascontiguousarray(as_codes(pixels))
