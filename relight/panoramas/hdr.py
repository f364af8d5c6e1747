"""Reads Radiance .hdr pictures strictly: a truncated file is an error.

Supported are all eight orientations, flat pixels, both run-length codings, and XYZE. EXPOSURE and COLORCORR are divided
out, and PRIMARIES converted. The format is described by Ward, "Real pixels" (Graphics Gems II) and "Radiance file
formats".
"""

import codecs
import re
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.panoramas.color import XYZ, convert_primaries
from relight.panoramas.panorama import check_size

PLAIN = (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 1 / 3, 1 / 3)  # Radiance's default, which hardly any file means
RESOLUTION = re.compile(rb"([+-])([XY]) +(\d{1,9}) +([+-])([XY]) +(\d{1,9})\s*")
MAX_HEADER = 65536
# Pixels and bytes of a packet by its first byte; tables are the fastest. Code 0 is invalid, so it overfills any line.
PACKET_PIXELS = [1 << 15, *range(1, 129), *range(1, 128)]
PACKET_BYTES = [*range(1, 130), *[2] * 127]
ROWS = 64  # rows that are decoded at a time, to limit memory


def read_hdr(path: Path) -> tuple[np.ndarray, list[str]]:
    """Reads a Radiance picture.

    Returns:
        Pixels (H,W,3) float32, linear Rec. 709, upright, with EXPOSURE divided out; and the conversions, one phrase
        each.

    Raises:
        UserError: if the file is not a whole Radiance picture.
    """
    data = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    try:
        divisor, xyz, primaries, notes, start = _read_header(data)
        is_column_major, sign1, sign2, height, width, start = _read_resolution(data, start)
        check_size(path, width, height)
        # The shortest scanlines: one old run of four bytes, or a marker and four channels of runs.
        min_bytes = height * (4 if width < 8 else 8)
        if len(data) - start < min_bytes:
            raise Malformed(f"{len(data) - start} bytes of pixels cannot hold {width} x {height} pixels")
        pixels = _read_pixels(data, start, height, width)
    except Malformed as problem:
        raise UserError(f"{path}: not a whole Radiance picture: {problem}") from None
    for channel in np.flatnonzero(divisor != 1):
        pixels[..., channel] /= np.float32(divisor[channel])
    repairs = convert_primaries(pixels, XYZ if xyz else primaries)
    if sign1 == (b"-" if is_column_major else b"+"):
        pixels = pixels[::-1]
    if sign2 == (b"+" if is_column_major else b"-"):
        pixels = pixels[:, ::-1]
    if is_column_major:
        pixels = pixels.transpose(1, 0, 2)
    return pixels, notes + (["converted from XYZ"] if xyz else repairs)


class Malformed(Exception):
    """Raised for bytes that are not a Radiance picture; the message is the reason."""


def _read_header(data: bytes) -> tuple[np.ndarray, bool, np.ndarray | None, list[str], int]:
    """Returns divisor (3,), whether pixels are XYZE, chromaticities (8,) or None, notes, and the end of the header.

    The divisor is the product of EXPOSURE and COLORCORR; indented lines belong to pictures that this one was made from.
    """
    divisor, xyz, primaries, position = np.ones(3), False, None, 0
    notes: list[str] = []
    while True:
        if (end := data.find(b"\n", position, MAX_HEADER)) < 0:
            raise Malformed("its header does not end")
        line, position = data[position:end].rstrip(), end + 1
        if not line:
            return divisor, xyz, primaries, notes, position
        key, _, value = line.partition(b"=")
        match key.rstrip():
            case b"FORMAT":
                if value.strip() not in (b"32-bit_rle_rgbe", b"32-bit_rle_xyze"):
                    raise Malformed(f"its FORMAT is {value.decode('latin-1')!r}")
                xyz = value.strip().endswith(b"xyze")
            case b"EXPOSURE" | b"COLORCORR" as name:
                divisor *= _numbers(value, 1 if name == b"EXPOSURE" else 3, 1e-30)
            case b"GAMMA" if value.strip() not in (b"1", b"1.0", b"1.00"):
                notes.append(f"its GAMMA of {value.strip().decode('latin-1')} is left out: pixels are taken as linear")
            case b"PRIMARIES":
                found = _numbers(value, 8, -1e30)
                primaries = None if not found.any() or np.allclose(found, PLAIN, atol=2e-3) else found


def _numbers(text: bytes, count: int, least: float) -> np.ndarray:
    """Returns the `count` numbers of a header value, from `least` to 1e30; raises Malformed for anything else."""
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.all((values > least) & (values < 1e30)):
        kind = "positive number(s)" if least > 0 else "numbers"
        raise Malformed(f"a header value is {text.decode('latin-1')!r}, not {count} {kind}")
    return values


def _read_resolution(data: bytes, position: int) -> tuple[bool, bytes, bytes, int, int, int]:
    """Returns whether scanlines are columns, the signs of the axes, the number and length of scanlines, and the end."""
    end = data.find(b"\n", position, position + 256)
    match = RESOLUTION.fullmatch(data[position:end]) if end >= 0 else None
    if match is None or match[2] == match[5]:
        raise Malformed("its resolution line is not like -Y 512 +X 1024")
    return match[2] == b"X", match[1], match[4], int(match[3]), int(match[6]), end + 1


def _read_pixels(data: bytes, position: int, height: int, width: int) -> np.ndarray:
    """Decodes all scanlines, from byte `position` of the file on, to (height,width,3) float32."""
    # A value is m * 2^(e - 136), and 0 for e = 0; float32 holds all but the 20 smallest exponents.
    scale = np.ldexp(1.0, np.arange(256) - 136).astype(np.float32)
    scale[0] = 0
    pixels = np.empty((height, width, 3), np.float32)
    source = np.frombuffer(data, np.uint8)
    for row in range(0, height, ROWS):
        block = np.empty((min(ROWS, height - row), width, 4), np.uint8)
        for line in block:
            position = _read_scanline(data, source, position, line)
        factor = scale[block[..., 3]]
        for channel in range(3):  # twice as fast as broadcasting over the channels
            np.multiply(block[..., channel], factor, out=pixels[row : row + len(block), :, channel])
    return pixels


def _read_scanline(data: bytes, source: np.ndarray, position: int, line: np.ndarray) -> int:
    """Fills a line (W,4) with the codes of a scanline in any coding; returns where the next one begins."""
    width = len(line)
    marker = data[position : position + 4]
    if len(marker) < 4:
        raise Malformed("it ends before its last scanline")
    if 8 <= width < 32768 and marker[0] == marker[1] == 2 and marker[2] < 128:
        if marker[2] << 8 | marker[3] != width:
            raise Malformed(f"a scanline says it has {marker[2] << 8 | marker[3]} pixels, not {width}")
        return _read_runs(data, source, position + 4, line)
    flat = source[position : position + 4 * width].reshape(-1, 4) if len(data) - position >= 4 * width else None
    if flat is not None and not np.any((flat[:, 0] == 1) & (flat[:, 1] == 1) & (flat[:, 2] == 1)):
        line[:] = flat
        return position + 4 * width
    return _read_old_runs(data, position, line)


def _read_runs(data: bytes, source: np.ndarray, position: int, line: np.ndarray) -> int:
    """Decodes a scanline of the new run-length coding, channel by channel, as `_read_scanline` does."""
    width, begin = len(line), position
    packet_starts = []
    try:
        for _ in range(4):
            filled = 0
            while filled < width:
                packet_starts.append(position)
                code = data[position]
                filled += PACKET_PIXELS[code]
                position += PACKET_BYTES[code]
            if filled != width:
                raise Malformed("a run extends beyond its scanline")
    except IndexError:
        position = len(data) + 1
    if position > len(data):
        raise Malformed("it ends inside a scanline")
    # Repeat counts of all bytes: 0 for a code byte, 1 for bytes of a literal, the code's count for the byte of a run.
    packets, start = source[begin:position], np.array(packet_starts) - begin
    code = packets[start]
    repeats = np.ones(len(packets), np.intp)
    repeats[start + 1] = np.where(code > 128, code - 128, 1)
    repeats[start] = 0
    line[:] = np.repeat(packets, repeats).reshape(4, width).T
    return position


def _read_old_runs(data: bytes, position: int, line: np.ndarray) -> int:
    """Decodes a scanline of the old run-length coding: (1,1,1,n) repeats the previous pixel n times.

    A second such code right after the first counts 256 n times, and so on.
    """
    width, filled, shift = len(line), 0, 0
    while filled < width:
        pixel = data[position : position + 4]
        if len(pixel) < 4:
            raise Malformed("it ends inside a scanline")
        position += 4
        if pixel[:3] == b"\1\1\1":
            count = pixel[3] << shift
            if not filled or filled + count > width:
                raise Malformed("a run extends beyond its scanline")
            line[filled : filled + count] = line[filled - 1]
            filled, shift = filled + count, min(shift + 8, 24)
            continue
        line[filled] = tuple(pixel)
        filled, shift = filled + 1, 0
    return position
