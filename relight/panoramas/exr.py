"""Reads OpenEXR panoramas; headers are checked before any pixel is read.

Only `OpenEXR.File` is used: the older `InputFile` crashes the process on truncated files.
"""

import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relight.files import UserError
from relight.panoramas.panorama import check_size

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
MAX_BYTES = 2**29  # of all channels at four bytes
FREE_BYTES, MOST_PACKED = 2**26, 2**11  # so much is believed of any file, more only at this ratio to the file's size
MOST_EMPTY = 64  # pixels of the display window for each of the data window
MAX_TILE = 2**20  # pixels; OpenEXR takes memory for a whole tile, also where the picture is smaller
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


@dataclass(frozen=True)
class ExrPicture:
    """What a file holds.

    Attributes:
        pixels: (H,W,3) float32, linear Rec. 709.
        envmap: the attribute of that name, "latlong", "cube" or None.
        repairs: a sentence each.
    """

    pixels: np.ndarray
    envmap: str | None
    repairs: list[str]


@dataclass(frozen=True)
class Header:
    """The relevant values of one part's header; windows are x0, y0, x1, y1, both ends included."""

    deep: bool
    tile: tuple[int, int] | None  # width and height
    channels: dict[str, tuple[int, int]]  # name to its sampling in x and y
    data: tuple[int, int, int, int]
    display: tuple[int, int, int, int]
    envmap: str | None
    chromaticities: tuple[float, ...] | None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the data window."""
        x0, y0, x1, y1 = self.data
        return x1 - x0 + 1, y1 - y0 + 1


def read_exr(path: Path) -> ExrPicture:
    """Reads the first part with colours, or with luminance alone.

    Raises:
        UserError: if the file is damaged, too large, or has no such part.
    """
    import OpenEXR

    headers = read_headers(path, OpenEXR)
    number = choose_part(path, headers)
    header = headers[number]
    try:
        with hushed():
            parts = OpenEXR.File(str(path), separate_channels=True, num_threads=1).parts
        if len(parts) < len(headers):  # the binding leaves out a part that it cannot read, and the others move up
            found = "its pixels" if len(headers) == 1 else f"the pixels of {len(headers) - len(parts)} of its parts"
            raise UserError(f"{path}: cut short or damaged: {found} cannot be read; get the file anew")
        stored = parts[number].channels
        planes = colour_planes(path, set(header.channels), lambda name: np.asarray(stored.pop(name).pixels))
    except UserError:
        raise
    except Exception as error:  # the binding raises whatever its layers raise, UnicodeDecodeError included
        raise UserError(f"{path}: OpenEXR cannot read it whole ({one_line(error)})") from error
    repairs = [f"part {number} of {len(headers)} was read"] if len(headers) > 1 else []
    pixels = on_display(path, header, planes, repairs)
    to_709 = chromaticity_matrix(header.chromaticities)
    if to_709 is not None:
        for row in range(0, len(pixels), 256):
            pixels[row : row + 256] = pixels[row : row + 256] @ to_709.T
        repairs.append("colours were converted to Rec. 709 from the file's chromaticities")
    return ExrPicture(pixels, header.envmap, repairs)


def read_headers(path: Path, OpenEXR: Any) -> list[Header]:
    """Reads the headers of all parts and no pixels; a damaged file may fail at any step, even at decoding a name."""
    envmaps = {OpenEXR.ENVMAP_LATLONG: "latlong", OpenEXR.ENVMAP_CUBE: "cube"}
    try:
        headers = []
        with hushed():
            parts = OpenEXR.File(str(path), header_only=True).parts
        for part in parts:
            header = dict(part.header)
            data, display = (window(header[name]) for name in ("dataWindow", "displayWindow"))
            colours, tiles = header.get("chromaticities"), header.get("tiles")
            headers.append(
                Header(
                    deep=header.get("type") not in (None, OpenEXR.scanlineimage, OpenEXR.tiledimage),
                    tile=None if tiles is None else (int(tiles.xSize), int(tiles.ySize)),
                    channels={str(c.name): (int(c.xSampling), int(c.ySampling)) for c in header["channels"]},
                    data=data,
                    display=display,
                    envmap=envmaps.get(header["envmap"]) if "envmap" in header else None,
                    chromaticities=None if colours is None else tuple(float(number) for number in colours),
                )
            )
        return headers
    except Exception as error:
        raise UserError(f"{path}: OpenEXR cannot read its header ({one_line(error)})") from error


@contextmanager
def hushed() -> Iterator[None]:
    """Keeps from the user what OpenEXR prints of a damaged file: a screenful of lines from C, and some by `print`."""
    nowhere, kept = os.open(os.devnull, os.O_WRONLY), None
    try:
        with suppress(OSError):  # a process may have closed its error stream
            kept = os.dup(2)
            os.dup2(nowhere, 2)
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        if kept is not None:
            os.dup2(kept, 2)
            os.close(kept)
        os.close(nowhere)


def window(box: Any) -> tuple[int, int, int, int]:
    """Returns a window of the binding as plain integers."""
    (x0, y0), (x1, y1) = box
    return int(x0), int(y0), int(x1), int(y1)


def choose_part(path: Path, headers: list[Header]) -> int:
    """Returns the first part with colours; raises UserError if there is none, or a part is too large or deep."""
    decoded, chosen = 0, None
    for number, header in enumerate(headers):
        if header.deep:
            raise UserError(f"{path}: a deep OpenEXR image; flatten it first")
        width, height = header.size
        check_size(path, width, height)
        if header.tile and header.tile[0] * header.tile[1] > max(MAX_TILE, width * height):
            raise UserError(f"{path}: damaged: its tiles ({header.tile[0]} x {header.tile[1]}) are larger than it is")
        decoded += width * height * len(header.channels) * 4
        if chosen is None and (set("RGB") <= set(header.channels) or "Y" in header.channels):
            chosen = number
    stored = path.stat().st_size
    if decoded > max(FREE_BYTES, MOST_PACKED * stored):
        raise UserError(f"{path}: damaged: its header promises {decoded >> 20} MB, and it has {stored >> 10} kB")
    if decoded > MAX_BYTES:
        raise UserError(f"{path}: {decoded >> 20} MB of channels, more than {MAX_BYTES >> 20}; keep only R, G and B")
    if chosen is None:
        found = ", ".join(sorted({name for header in headers for name in header.channels})[:8])
        raise UserError(f"{path}: has the channels {found or 'none'}; a panorama has R, G and B, or Y")
    if {"RY", "BY"} & set(headers[chosen].channels):
        raise UserError(f"{path}: luminance-chroma OpenEXR, which keeps colour at half the size; save it as RGB")
    for name, sampling in headers[chosen].channels.items():
        if name in "RGBY" and sampling != (1, 1):
            raise UserError(f"{path}: its channel {name} is subsampled; save it with a sample per pixel")
    return chosen


def colour_planes(path: Path, names: set[str], take: Callable[[str], np.ndarray]) -> np.ndarray:
    """Stacks the channels that `take` returns by name to (h,w,3) float32; each is freed once it is copied."""
    if not names >= {"R", "G", "B"}:
        return np.repeat(take("Y").astype(np.float32)[..., None], 3, 2)
    red = take("R")
    pixels = np.empty((*red.shape, 3), np.float32)
    pixels[..., 0] = red
    del red
    for c, name in ((1, "G"), (2, "B")):
        plane = take(name)
        if plane.shape != pixels.shape[:2]:
            raise UserError(f"{path}: its channels differ in size")
        pixels[..., c] = plane
    return pixels


def on_display(path: Path, header: Header, pixels: np.ndarray, repairs: list[str]) -> np.ndarray:
    """Brings pixels from the data window to the display window: missing ones are black, those outside are cut off."""
    (x0, y0, x1, y1), (dx, dy, ex, ey) = header.data, header.display
    if pixels.shape[1::-1] != header.size:
        raise UserError(f"{path}: its pixels are not the size that its header says")
    if header.display == header.data:
        return pixels
    width, height = ex - dx + 1, ey - dy + 1
    check_size(path, width, height)
    if width * height > MOST_EMPTY * pixels[..., 0].size:
        raise UserError(f"{path}: damaged: its display window ({width} x {height}) is nearly empty")
    canvas = np.zeros((height, width, 3), np.float32)
    left, top, right, bottom = max(x0, dx), max(y0, dy), min(x1, ex), min(y1, ey)
    if left > right or top > bottom:
        raise UserError(f"{path}: its pixels lie outside its display window")
    inside = pixels[top - y0 : bottom - y0 + 1, left - x0 : right - x0 + 1]
    canvas[top - dy : bottom - dy + 1, left - dx : right - dx + 1] = inside
    repairs.append("its pixels do not fill its display window; the rest is black")
    return canvas


def chromaticity_matrix(chromaticities: tuple[float, ...] | None) -> np.ndarray | None:
    """Returns the matrix (3,3) float32 to linear Rec. 709, or None if the colours are Rec. 709, as by default.

    White is adapted (Bradford), except for files in XYZ, whose values are absolute.
    """
    if chromaticities is None:
        return None
    xy = np.array(chromaticities)
    if xy.shape != (8,) or not np.all(np.isfinite(xy)) or np.allclose(xy, REC709, atol=2e-3):
        return None
    ours, theirs = primaries(np.array(REC709)), primaries(xy)
    if ours is None or theirs is None:
        return None
    adapt = np.eye(3)
    if not np.allclose(xy[6:], 1 / 3, atol=2e-3):
        cone = (BRADFORD @ ours.sum(1)) / (BRADFORD @ theirs.sum(1))
        adapt = np.linalg.inv(BRADFORD) @ np.diag(cone) @ BRADFORD
    return (np.linalg.inv(ours) @ adapt @ theirs).astype(np.float32)


def primaries(xy: np.ndarray) -> np.ndarray | None:
    """Returns the matrix (3,3) from RGB to XYZ of primaries and white (8,), with a white of luminance 1.

    None if the primaries are degenerate.
    """
    points = xy.reshape(4, 2)
    xyz = np.concatenate([points, 1 - points.sum(1, keepdims=True)], 1).T
    if abs(np.linalg.det(xyz[:, :3])) < 1e-6 or abs(xyz[1, 3]) < 1e-6:
        return None
    return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3] / xyz[1, 3])


def one_line(error: Exception) -> str:
    """Returns the message of an exception on one line, or its type if it has none."""
    return " ".join(str(error).split())[:200] or type(error).__name__
