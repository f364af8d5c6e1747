"""Photos of more than 8 bits, read and written in kind: 16-bit PNG and TIFF by the coders of FFmpeg, linear OpenEXR."""

from fractions import Fraction
from pathlib import Path
from typing import cast

import numpy as np
import OpenEXR
from PIL import Image

from relight import __version__
from relight.errors import UserError
from relight.files import atomic_write
from relight.panoramas.exr import read_exr

EXR_MAGIC = b"\x76\x2f\x31\x01"
# How the eight EXIF orientations are turned upright.
UPRIGHT = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a[::-1, ::-1].swapaxes(0, 1),
    8: lambda a: np.rot90(a),
}


def is_exr(path: Path) -> bool:
    """Returns whether a file is an OpenEXR picture, by its first bytes."""
    with open(path, "rb") as file:
        return file.read(4) == EXR_MAGIC


def read_16_bits(path: Path, image: Image.Image, orientation: int, what: str) -> np.ndarray:
    """Reads a PNG or TIFF of 16 bits per channel, of which Pillow keeps the upper half.

    Both readers must agree in that half, so no layout of a file is misread.

    Args:
        path: of the file.
        image: as Pillow read it, RGB or RGBA, upright.
        orientation: of its EXIF data, as stored.
        what: its name in errors.

    Returns:
        (H,W,3) uint16, upright.

    Raises:
        UserError: if the file is of a kind that only Pillow reads.
    """
    import av

    try:
        with av.open(str(path)) as container:
            stored = next(container.decode(video=0)).to_ndarray(format="rgba64le")[..., :3]
    except (av.FFmpegError, StopIteration, ValueError):
        stored = np.zeros((0, 0, 3), np.uint16)
    pixels = UPRIGHT.get(orientation, UPRIGHT[1])(stored)
    upper = np.asarray(image.convert("RGB"))
    if pixels.shape != upper.shape or not np.array_equal(pixels >> 8, upper):
        raise UserError(
            f"{what} cannot be read in 16 bits: save it as PNG, or as TIFF in strips with the channels of each pixel "
            "together"
        )
    return np.ascontiguousarray(pixels)


def read_linear(path: Path, what: str) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Reads an OpenEXR photo.

    Args:
        path: of the file.
        what: its name in errors.

    Returns:
        Pixels (H,W,3) float32, linear Rec. 709; alpha (H,W) uint8, or None if it does not vary; notes.

    Raises:
        UserError: if it is damaged, or has pixels that are not finite.
    """
    picture = read_exr(path)
    pixels, notes = np.ascontiguousarray(picture.pixels), picture.repairs
    if not np.isfinite(pixels).all():
        raise UserError(f"{what} has pixels that are not finite numbers: repair it first")
    alpha = None
    if picture.alpha is not None and np.ptp(np.nan_to_num(picture.alpha)) > 0:
        share = np.nan_to_num(picture.alpha).clip(0, 1)
        pixels /= np.where(share > 0, share, 1)[..., None]  # OpenEXR's colors are multiplied by alpha
        alpha = np.round(share * 255).astype(np.uint8)
    if (pixels < 0).any():
        notes.append(f"{int((pixels < 0).any(-1).sum())} pixels had negative values, set to zero")
        pixels = np.maximum(pixels, 0)
    return pixels, alpha, notes


def write_deep(path: Path, pixels: np.ndarray) -> None:
    """Writes (H,W,3|4) uint16 as .png or .tif, or float32 as .exr, by the suffix."""
    with atomic_write(path) as tmp:
        if path.suffix == ".exr":
            channels = {name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGBA"[: pixels.shape[2]])}
            if "A" in channels:
                channels |= {name: channels[name] * channels["A"] for name in "RGB"}
            OpenEXR.File({"software": f"relight {__version__}"}, channels).write(str(tmp))
        else:
            tmp.write_bytes(_encoded(pixels, {".png": "png", ".tif": "tiff"}[path.suffix]))


def _encoded(pixels: np.ndarray, coder: str) -> bytes:
    """Returns the bytes of a picture of 16 bits.

    `pixels` are (H,W,3) or (H,W,4) uint16; `coder` is an encoder of FFmpeg, `png` or `tiff`.
    """
    import av

    form = {3: "rgb48", 4: "rgba64"}[pixels.shape[2]] + {"png": "be", "tiff": "le"}[coder]
    context = cast(av.VideoCodecContext, av.CodecContext.create(coder, "w"))
    context.height, context.width = pixels.shape[:2]
    context.pix_fmt, context.time_base = form, Fraction(1)
    if coder == "tiff":
        context.options = {"compression_algo": "deflate"}
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format=form)
    return b"".join(bytes(packet) for packet in [*context.encode(frame), *context.encode(None)])
