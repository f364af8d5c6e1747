"""Reads Radiance .hdr pictures strictly: a file that is not whole is an error.

All eight orientations, flat and both kinds of run-length pixels, EXPOSURE and COLORCORR divided out, XYZE converted
(Ward, "Real pixels", Graphics Gems II; "Radiance file formats").
"""

import re
from pathlib import Path

import numpy as np

from relight.files import UserError
from relight.panoramas.panorama import check_size

XYZ_TO_RGB = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875992, 0.041556], [0.055648, -0.204043, 1.057311]]
)
RESOLUTION = re.compile(rb"([+-])([XY]) +(\d{1,9}) +([+-])([XY]) +(\d{1,9})\s*")
MAX_HEADER = 65536
# By the first byte of a packet, the number of pixels that it fills and of bytes that it has. Tables, because scanlines
# of short runs spend most of their time here. A literal of no bytes is an error: it fills more than a line.
FILLS = [1 << 15, *range(1, 129), *range(1, 128)]
SIZES = [*range(1, 130), *[2] * 127]
ROWS = 64  # expanded and converted at a time, so that hardly more memory is used than for the picture itself


def read_hdr(path: Path) -> tuple[np.ndarray, list[str]]:
    """Reads a Radiance picture.

    Returns:
        Pixels (H,W,3) float32, linear Rec. 709, upright, with EXPOSURE divided out; and the conversions, a sentence
        each.

    Raises:
        UserError: if the file is not a whole Radiance picture.
    """
    data = path.read_bytes()
    try:
        divisor, xyz, start = read_header(data)
        swap, first, second, height, width, start = read_resolution(data, start)
        check_size(path, width, height)
        # A scanline has at least four bytes, and two more for each run of 127 in each of its four channels.
        least = height * (4 if width < 8 else 8)
        if len(data) - start < least:
            raise Malformed(f"{len(data) - start} bytes of pixels cannot hold {width} x {height} pixels")
        pixels = read_pixels(data, start, height, width)
    except Malformed as problem:
        raise UserError(f"{path}: not a whole Radiance picture: {problem}") from None
    for row in range(0, height, ROWS):
        part = pixels[row : row + ROWS]
        if xyz:
            part[:] = part @ XYZ_TO_RGB.T.astype(np.float32)
        for channel in np.flatnonzero(divisor != 1):
            part[..., channel] /= np.float32(divisor[channel])
    if first == b"+" if not swap else first == b"-":
        pixels = pixels[::-1]
    if second == b"-" if not swap else second == b"+":
        pixels = pixels[:, ::-1]
    if swap:
        pixels = pixels.transpose(1, 0, 2)
    return pixels, ["converted from XYZ"] if xyz else []


class Malformed(Exception):
    """Raised for bytes that are not a Radiance picture; the message is the reason."""


def read_header(data: bytes) -> tuple[np.ndarray, bool, int]:
    """Returns the product of EXPOSURE and COLORCORR (3,), whether pixels are XYZE, and where the resolution starts."""
    if not data.startswith(b"#?"):
        raise Malformed("it does not begin with #?")
    divisor, xyz, place = np.ones(3), False, 0
    while True:
        end = data.find(b"\n", place, MAX_HEADER)
        if end < 0:
            raise Malformed("its header has no end")
        line, place = data[place:end].strip(), end + 1
        if not line:
            return divisor, xyz, place
        key, _, value = line.partition(b"=")
        match key.strip():
            case b"FORMAT":
                if value.strip() not in (b"32-bit_rle_rgbe", b"32-bit_rle_xyze"):
                    raise Malformed(f"its FORMAT is {value.decode('latin-1')!r}")
                xyz = value.strip().endswith(b"xyze")
            case b"EXPOSURE":
                divisor *= numbers(value, 1)
            case b"COLORCORR":
                divisor *= numbers(value, 3)


def numbers(text: bytes, count: int) -> np.ndarray:
    """Parses `count` positive numbers of a header's value."""
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.all((values > 1e-30) & (values < 1e30)):
        raise Malformed(f"a header value is {text.decode('latin-1')!r}, not {count} positive number(s)")
    return values


def read_resolution(data: bytes, place: int) -> tuple[bool, bytes, bytes, int, int, int]:
    """Returns whether scanlines are columns, the two signs, count and length of scanlines, and where pixels start."""
    end = data.find(b"\n", place, place + 256)
    match = RESOLUTION.fullmatch(data[place:end]) if end >= 0 else None
    if match is None or match[2] == match[5]:
        raise Malformed("its resolution line is not like -Y 512 +X 1024")
    return match[2] == b"X", match[1], match[4], int(match[3]), int(match[6]), end + 1


def read_pixels(data: bytes, place: int, height: int, width: int) -> np.ndarray:
    """Decodes scanlines to (height,width,3) float32; each may be flat or in the old or new run-length coding."""
    # m * 2^(e - 136), zero for e = 0 (Ward); float32 holds all but the 20 smallest exponents.
    scale = np.ldexp(1.0, np.arange(256) - 136).astype(np.float32)
    scale[0] = 0
    pixels = np.empty((height, width, 3), np.float32)
    source = np.frombuffer(data, np.uint8)
    for row in range(0, height, ROWS):
        block = np.empty((min(ROWS, height - row), width, 4), np.uint8)
        for line in block:
            place = read_scanline(data, source, place, line)
        factor = scale[block[..., 3]]
        for channel in range(3):  # numpy's inner loop over three channels takes twice as long
            np.multiply(block[..., channel], factor, out=pixels[row : row + len(block), :, channel])
    return pixels


def read_scanline(data: bytes, source: np.ndarray, place: int, line: np.ndarray) -> int:
    """Decodes the scanline that starts at `place` into `line` (W, 4) uint8; returns where the next one starts."""
    width = len(line)
    mark = data[place : place + 4]
    if len(mark) < 4:
        raise Malformed("it ends before its last scanline")
    if 8 <= width < 32768 and mark[0] == mark[1] == 2 and mark[2] < 128:
        if mark[2] << 8 | mark[3] != width:
            raise Malformed(f"a scanline says it has {mark[2] << 8 | mark[3]} pixels, not {width}")
        return read_runs(data, source, place + 4, line)
    flat = source[place : place + 4 * width].reshape(-1, 4) if len(data) - place >= 4 * width else None
    if flat is not None and not np.any((flat[:, 0] == 1) & (flat[:, 1] == 1) & (flat[:, 2] == 1)):
        line[:] = flat
        return place + 4 * width
    return read_old_runs(data, place, line)


def read_runs(data: bytes, source: np.ndarray, place: int, line: np.ndarray) -> int:
    """Decodes the new run-length coding, four channels one after another; arguments as for `read_scanline`."""
    width, begin = len(line), place
    starts = []
    try:
        for _ in range(4):
            filled = 0
            while filled < width:
                starts.append(place)
                code = data[place]
                filled += FILLS[code]
                place += SIZES[code]
            if filled != width:
                raise Malformed("a run leaves its scanline")
    except IndexError:
        place = len(data) + 1
    if place > len(data):
        raise Malformed("it ends inside a scanline")
    # Each packet without its code byte: the bytes of a literal once, the byte of a run as often as the code says.
    packets, start = source[begin:place], np.array(starts) - begin
    code = packets[start]
    repeats = np.ones(len(packets), np.intp)
    repeats[start + 1] = np.where(code > 128, code - 128, 1)
    repeats[start] = 0
    line[:] = np.repeat(packets, repeats).reshape(4, width).T
    return place


def read_old_runs(data: bytes, place: int, line: np.ndarray) -> int:
    """Decodes the old run-length coding: (1,1,1,n) repeats the pixel before it n times, a second one 256 n times."""
    width, filled, shift = len(line), 0, 0
    while filled < width:
        pixel = data[place : place + 4]
        if len(pixel) < 4:
            raise Malformed("it ends inside a scanline")
        place += 4
        if pixel[:3] == b"\1\1\1":
            count = pixel[3] << shift
            if not filled or filled + count > width:
                raise Malformed("a run leaves its scanline")
            line[filled : filled + count] = line[filled - 1]
            filled, shift = filled + count, min(shift + 8, 24)
            continue
        line[filled] = tuple(pixel)
        filled, shift = filled + 1, 0
    return place
