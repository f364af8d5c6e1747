"""Reads OpenEXR panoramas; headers are checked before any pixel is read.

Only `OpenEXR.File` is used: the older `InputFile` crashes the process on truncated files.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.processes import without_messages
from relight.core.srgb import decode
from relight.panoramas.color import XYZ, convert_primaries
from relight.panoramas.panorama import check_size

MAX_BYTES = 2**29  # decoded size, all channels at four bytes
UNCHECKED_BYTES = 2**26  # decoded size up to which the compression ratio is not checked
MAX_COMPRESSION = 2**11  # decoded size over file size
MAX_WINDOW_RATIO = 64  # area of the display window over that of the data window
MAX_TILE_PIXELS = 2**20  # OpenEXR allocates whole tiles, even if the image is smaller
SPACE = re.compile(r"(.*[:./])?color[_ ]?(space|interop_?id)", re.I)  # attributes that name the color space
REC709_SPACE = re.compile(r"(?!.*non).*(lin.*(709|srgb)|(709|srgb).*lin).*|(scene[-_ ])?lin(ear)?|raw|data|", re.I)
LINEAR_SPACE = re.compile(r"(?!.*non).*lin|aces(cg|2065.*)?$|.*xyz", re.I)
CODES = re.compile(r"(utility - )?srgb([-_ ]+(tx|texture|rec709_(scene|display)|encoded rec\.709.*|iec.*))?", re.I)
MAX_NEGATIVE = 0.01  # share of the largest value, below zero, that colors may have; positions have more


@dataclass(frozen=True)
class ExrPicture:
    """The pixels of an OpenEXR file.

    Attributes:
        pixels: (H,W,3) float32, linear Rec. 709.
        envmap: the layout that the header attribute `envmap` tells, "latlong" or "strip", or None.
        repairs: what was changed, one sentence each.
        alpha: (H,W) float32, by which the colors are multiplied, or None.
    """

    pixels: np.ndarray
    envmap: str | None
    repairs: list[str]
    alpha: np.ndarray | None = None


@dataclass(frozen=True)
class Header:
    """The header of one part. Windows are (x0, y0, x1, y1), both ends included.

    Attributes:
        deep: whether the part stores deep samples.
        tile: width and height of a tile; None for scanlines.
        channels: sampling in x and y, by name.
        data: window of the stored pixels.
        display: window of the image.
        envmap: the layout that the attribute `envmap` tells, "latlong" or "strip", or None.
        chromaticities: x and y of the primaries and of white (8 numbers), or None.
        space: the color space that an attribute names, or "".
    """

    deep: bool
    tile: tuple[int, int] | None
    channels: dict[str, tuple[int, int]]
    data: tuple[int, ...]
    display: tuple[int, ...]
    envmap: str | None
    chromaticities: Any
    space: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the data window."""
        x0, y0, x1, y1 = self.data
        return x1 - x0 + 1, y1 - y0 + 1


def read_exr(path: Path) -> ExrPicture:
    """Reads the first part that has RGB, XYZ or luminance channels.

    Raises:
        UserError: if the file is damaged, too large, or has no such part.
    """
    import OpenEXR

    headers = _read_headers(path, OpenEXR)
    number = _choose_part(path, headers)
    header = headers[number]
    try:
        with without_messages():  # about damaged files
            parts = OpenEXR.File(str(path), separate_channels=True, num_threads=1).parts
        if len(parts) < len(headers):  # the binding omits unreadable parts, which shifts the indices of the others
            missing = "its pixels" if len(headers) == 1 else f"the pixels of {len(headers) - len(parts)} of its parts"
            raise UserError(f"{path}: cut short or damaged: {missing} cannot be read; download the file again")
        stored = parts[number].channels
        names = _color_channels(header.channels) or ""
        window_pixels = np.empty((*header.size[::-1], 3), np.float32)
        for channel in range(3):
            window_pixels[..., channel] = stored[names[channel % len(names)]].pixels
        alpha = np.asarray(stored["A"].pixels, np.float32) if "A" in header.channels else None
    except UserError:
        raise
    except Exception as error:  # the binding raises many types, UnicodeDecodeError included
        raise UserError(f"{path}: OpenEXR cannot read all of its pixels ({_one_line(error)})") from error
    repairs = [f"part {number} of {len(headers)} was read"] if len(headers) > 1 else []
    pixels = _to_display_window(path, header, window_pixels, repairs)
    if names == "XYZ":
        if np.fmin.reduce(pixels, axis=None) < -MAX_NEGATIVE * np.fmax.reduce(pixels, axis=None):
            raise UserError(f"{path}: its channels X, Y and Z have negative values, as positions do; light has R, G, B")
        convert_primaries(pixels, XYZ)
        repairs.append("its channels X, Y and Z were taken as CIE XYZ and converted to Rec. 709")
    else:
        repairs += _decode(header, pixels) + convert_primaries(pixels, header.chromaticities)
    if alpha is not None and alpha.shape == window_pixels.shape[:2]:
        alpha = _to_display_window(path, header, alpha[..., None], [])[..., 0]
    return ExrPicture(pixels, header.envmap, repairs, alpha)


def _read_headers(path: Path, OpenEXR: Any) -> list[Header]:
    """Reads the headers of all parts; raises UserError if any step fails: in a damaged file decoding a name may."""
    envmaps = {OpenEXR.ENVMAP_LATLONG: "latlong", OpenEXR.ENVMAP_CUBE: "strip"}
    try:
        headers = []
        with without_messages():
            parts = OpenEXR.File(str(path), header_only=True).parts
        for part in parts:
            header = {name.lower(): value for name, value in part.header.items()}  # of any spelling
            data, display = (tuple(np.ravel(header[name]).tolist()) for name in ("datawindow", "displaywindow"))
            tiles = header.get("tiles")
            deep = header.get("type") not in (None, OpenEXR.scanlineimage, OpenEXR.tiledimage)
            tile = None if tiles is None else (int(tiles.xSize), int(tiles.ySize))
            channels = {str(c.name): (int(c.xSampling), int(c.ySampling)) for c in header["channels"]}
            envmap = envmaps.get(header["envmap"]) if "envmap" in header else None
            colors = header.get("chromaticities"), _space(header)
            headers.append(Header(deep, tile, channels, data, display, envmap, *colors))
        return headers
    except Exception as error:
        raise UserError(f"{path}: OpenEXR cannot read its header ({_one_line(error)})") from error


def _space(header: dict[str, Any]) -> str:
    """Returns the color space that a header names, by colorInteropID, the newest attribute, first; or ""."""
    names = sorted(filter(SPACE.fullmatch, header))  # the newest is the first in the alphabet, too
    named = next((str(header[name]).strip() for name in names if header[name]), "")
    return named or ("ACES" if header.get("acesimagecontainerflag") else "")


def _decode(header: Header, pixels: np.ndarray) -> list[str]:
    """Decodes pixels (H,W,3) in place if they are codes of sRGB, as the header says and as none is above 1.

    Returns what is unusual about the space that the header names in a sentence, or an empty list.
    """
    said = f"it names the color space {header.space}"
    if CODES.fullmatch(header.space) and np.fmax.reduce(pixels, axis=None) <= 1.001:
        for row in range(0, len(pixels), 256):  # 256 rows at a time, to limit memory
            pixels[row : row + 256] = decode(pixels[row : row + 256])
        return [f"{said}: its codes were decoded"]
    if header.chromaticities is not None:
        return [] if not header.space or LINEAR_SPACE.match(header.space) else [f"{said}: taken as linear"]
    return [] if REC709_SPACE.fullmatch(header.space) else [f"{said} without chromaticities: taken for linear Rec. 709"]


def _choose_part(path: Path, headers: list[Header]) -> int:
    """Returns the index of the first part with colors; UserError if none can be read."""
    decoded, selected = 0, None
    for number, header in enumerate(headers):
        if header.deep:
            raise UserError(f"{path} is a deep OpenEXR image: flatten it first")
        width, height = header.size
        check_size(path, width, height)
        if header.tile and header.tile[0] * header.tile[1] > max(MAX_TILE_PIXELS, width * height):
            tile = f"{header.tile[0]} x {header.tile[1]}"
            raise UserError(f"{path}: damaged: its tiles ({tile}) are larger than the image ({width} x {height})")
        decoded += width * height * len(header.channels) * 4
        if selected is None and _color_channels(header.channels):
            selected = number
    stored = path.stat().st_size
    if decoded > max(UNCHECKED_BYTES, MAX_COMPRESSION * stored):
        raise UserError(f"{path}: damaged: its header declares {decoded >> 20} MB, but the file has {stored >> 10} kB")
    if decoded > MAX_BYTES:
        raise UserError(f"{path} has {decoded >> 20} MB of channels, over {MAX_BYTES >> 20} MB: keep only R, G and B")
    if selected is None:
        found = ", ".join(sorted({name for header in headers for name in header.channels})[:8])
        raise UserError(
            f"{path} has the channels {found or 'none'}; a picture has R, G and B, or X, Y and Z, or Y: save the layer "
            "that you mean under these names"
        )
    if {"RY", "BY"} & set(headers[selected].channels):
        raise UserError(f"{path} is a luminance-chroma OpenEXR image, with color at half the size: save it as RGB")
    for name, sampling in headers[selected].channels.items():
        if name in "RGBXYZ" and sampling != (1, 1):
            raise UserError(f"{path}: its channel {name} is subsampled: save it with one sample per pixel")
    return selected


def _color_channels(channels: Collection[str]) -> str | None:
    """Returns which channels hold the color: "RGB", "XYZ" or "Y", luminance; None if none do.

    Y beside X alone is a coordinate. Z alone is a depth, so Y beside it is luminance.
    """
    if {"R", "G", "B"} <= set(channels):
        return "RGB"
    if {"X", "Y", "Z"} <= set(channels):
        return "XYZ"
    return "Y" if "Y" in channels and "X" not in channels else None


def _to_display_window(path: Path, header: Header, pixels: np.ndarray, repairs: list[str]) -> np.ndarray:
    """Crops and pads pixels (h,w,C) to the display window, in black; `repairs` gets how the windows differ."""
    (x0, y0, x1, y1), (display_x0, display_y0, display_x1, display_y1) = header.data, header.display
    if header.display == header.data:
        return pixels
    width, height = display_x1 - display_x0 + 1, display_y1 - display_y0 + 1
    check_size(path, width, height)
    if width * height > MAX_WINDOW_RATIO * pixels[..., 0].size:
        raise UserError(f"{path}: damaged: its display window ({width} x {height}) is nearly empty")
    canvas = np.zeros((height, width, pixels.shape[2]), np.float32)
    left, top, right, bottom = max(x0, display_x0), max(y0, display_y0), min(x1, display_x1), min(y1, display_y1)
    if left > right or top > bottom:
        raise UserError(f"{path}: its data window lies outside its display window")
    inside = pixels[top - y0 : bottom - y0 + 1, left - x0 : right - x0 + 1]
    canvas[top - display_y0 : bottom - display_y0 + 1, left - display_x0 : right - display_x0 + 1] = inside
    if inside.size < canvas.size:
        repairs.append("its pixels do not fill its display window; the rest is black")
    if inside.size < pixels.size:
        repairs.append("its pixels beyond its display window are left out")
    return canvas


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
