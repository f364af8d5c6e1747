"""Photos of more than 8 bits, read and written in kind: 16-bit PNG and TIFF by OpenImageIO, linear OpenEXR."""

from pathlib import Path

import numpy as np
import OpenEXR

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.core.version import __version__
from relight.panoramas.exr import read_exr

EXR_MAGIC = b"\x76\x2f\x31\x01"
UNASSOCIATED = "oiio:UnassociatedAlpha"  # colors are not multiplied by alpha; else OpenImageIO multiplies them


def is_linear(path: Path) -> bool:
    """Returns whether `read_linear` reads a file, by its first bytes."""
    with open(path, "rb") as file:
        return file.read(4) == EXR_MAGIC


def read_16_bits(path: Path, what: str, page: int = 0) -> tuple[np.ndarray, np.ndarray | None]:
    """Reads a PNG or TIFF of 16 bits per channel, of which Pillow keeps the upper half.

    Args:
        path: of the file.
        what: its name in errors.
        page: of a TIFF.

    Returns:
        (H,W,3) uint16, as stored; alpha (H,W) uint16, or None.

    Raises:
        UserError: if it is damaged.
    """
    import OpenImageIO as oiio

    wanted = oiio.ImageSpec()
    wanted[UNASSOCIATED] = 1
    image = oiio.ImageBuf(str(path), page, 0, wanted)
    if not image.read(page, force=True, convert=oiio.UINT16):
        raise UserError(f"{what} is damaged or cut short ({image.geterror().splitlines()[0]})")
    spec = image.spec()
    alpha_channel, is_multiplied = spec.alpha_channel, not spec.get_int_attribute(UNASSOCIATED)
    values = np.asarray(image.get_pixels(oiio.UINT16))
    alpha = values[..., alpha_channel] if alpha_channel >= 0 else None
    pixels = values[..., :3] if values.shape[2] > 2 else np.repeat(values[..., :1], 3, axis=2)
    if alpha is not None and is_multiplied:
        share = np.maximum(alpha, 1)[..., None] / np.float32(65535)
        pixels = np.round(np.minimum(pixels / share, 65535)).astype(np.uint16)
    return pixels, alpha


def read_linear(path: Path, what: str) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Reads an OpenEXR photo.

    Args:
        path: of the file.
        what: its name in errors.

    Returns:
        Pixels (H,W,3) float32, linear Rec. 709; alpha (H,W) float32 in [0,1], or None; notes.

    Raises:
        UserError: if it is damaged, or has pixels that are not finite.
    """
    picture = read_exr(path)
    pixels, alpha = picture.pixels, None
    if picture.alpha is not None:
        alpha = np.nan_to_num(picture.alpha).clip(0, 1)
        pixels = pixels / np.where(alpha > 0, alpha, 1)[..., None]  # OpenEXR's colors are multiplied by alpha
    pixels, notes = of_linear(pixels, what)
    return pixels, alpha, picture.repairs + notes


def of_linear(values: np.ndarray, what: str) -> tuple[np.ndarray, list[str]]:
    """Returns linear values (H,W,3) of any float type as float32 without negative ones, and what was changed.

    Raises:
        UserError: if some are not finite in float32.
    """
    with np.errstate(over="ignore"):
        pixels = np.ascontiguousarray(values, np.float32)
    if not np.isfinite(pixels).all():
        raise UserError(f"{what} has pixels that are not finite numbers: repair it first")
    negative = int((pixels < 0).any(-1).sum())
    return np.maximum(pixels, 0), [f"{negative} pixels had negative values, set to zero"] * bool(negative)


def write_deep(path: Path, pixels: np.ndarray) -> None:
    """Writes (H,W,3|4) uint16 as .png or .tif, or float32 as .exr, by the suffix."""
    suffix = path.suffix.lower()
    with atomic_write(path) as tmp:
        if suffix == ".exr":
            channels = {name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGBA"[: pixels.shape[2]])}
            if "A" in channels:
                channels |= {name: channels[name] * channels["A"] for name in "RGB"}
            OpenEXR.File({"software": f"relight {__version__}"}, channels).write(str(tmp))
        else:
            import OpenImageIO as oiio

            image = oiio.ImageBuf(np.ascontiguousarray(pixels))
            image.specmod()[UNASSOCIATED] = 1
            image.specmod()["compression"] = "zip"
            if not image.write(str(tmp), oiio.UINT16, {".png": "png", ".tif": "tiff"}[suffix]):
                raise OSError(image.geterror())
