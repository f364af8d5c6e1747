"""Reads portable float maps: PF (color) and Pf (grey), rows from the bottom up; Photoshop's from the top down."""

import re
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.panoramas.panorama import check_size

MIN_LARGEST, MAX_LARGEST = 1e-20, 1e20  # of the values
NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
HEADER = re.compile(rb"(?:\xef\xbb\xbf)?(PF|Pf)\s+(\d{1,9})(\s+)(\d{1,9})\s+(" + NUMBER + rb")(\r\n|\s)")


def read_pfm(path: Path) -> tuple[np.ndarray, list[str]]:
    """Reads a portable float map.

    Returns:
        Pixels (H,W,3) float32, row 0 at the top; and notes, one phrase each.

    Raises:
        UserError: if the file is damaged.
    """
    data = path.read_bytes()
    match = HEADER.match(data[:256])
    scale = float(match[5]) if match else 0.0
    if match is None or not np.isfinite(scale) or scale == 0:
        raise UserError(f"{path}: not a portable float map: its header is not like 'PF 1024 512 -1.0'")
    width, height, channels = int(match[2]), int(match[4]), 3 if match[1] == b"PF" else 1
    check_size(path, width, height)
    needed, start = width * height * channels * 4, match.end()
    if match[6] == b"\r\n" and len(data) - start == needed - 1:  # the CR ends the header, and the LF is a pixel's
        start -= 1
    if len(data) - start < needed:
        raise UserError(f"{path}: {len(data) - start} bytes of pixels are too few for {width} x {height}")
    if len(data) - start > needed:
        raise UserError(f"{path}: {len(data) - start - needed} bytes are left over after {width} x {height} pixels")
    stored = np.frombuffer(data, "<f4" if scale < 0 else ">f4", width * height * channels, start)
    pixels = stored.reshape(height, width, channels).astype(np.float32)
    largest = float(np.abs(pixels, where=np.isfinite(pixels), out=np.zeros_like(pixels)).max())
    if largest and not MIN_LARGEST < largest < MAX_LARGEST:
        raise UserError(f"{path}: its largest value is {largest:.2g}, as if its bytes were in another order")
    notes = [] if abs(scale) == 1 else [f"its scale of {abs(scale):g} is left out, as by most programs"]
    if match[3].strip(b" \t"):  # a line break: only Photoshop writes one there
        notes.append("its rows were taken from the top down, as its header is Photoshop's")
    else:
        pixels = pixels[::-1]
    return np.repeat(pixels, 3, 2) if channels == 1 else pixels, notes
