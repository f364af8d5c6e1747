"""How large a panorama may be: decided before any pixel is read."""

from pathlib import Path

from relight.files import UserError

PIXELS = 2**25  # 8192 x 4096
DECODED = 2**29  # bytes of an OpenEXR file with all its channels at four bytes


def check_size(path: Path, width: int, height: int) -> None:
    """UserError for a picture of no pixels or of more than 8192 x 4096."""
    if width <= 0 or height <= 0:
        raise UserError(f"{path}: its size is {width} x {height}; a panorama has pixels")
    if width * height > PIXELS:
        raise UserError(f"{path}: {width} x {height} pixels are more than 8192 x 4096; make it smaller first")
