"""Reads portable float maps: PF (colour) and Pf (grey), rows from the bottom up."""

import re
from pathlib import Path

import numpy as np

from relight.files import UserError
from relight.panoramas.panorama import check_size

HEADER = re.compile(rb"(PF|Pf)\s+(\d{1,9})\s+(\d{1,9})\s+([-+.0-9eE]{1,32})\s")


def read_pfm(path: Path) -> np.ndarray:
    """Returns the pixels (H,W,3) float32, row 0 at the top; raises UserError if the file is damaged."""
    data = path.read_bytes()
    match = HEADER.match(data[:256])
    try:
        scale = float(match[4]) if match else 0.0
    except ValueError:
        scale = 0.0
    if match is None or not np.isfinite(scale) or scale == 0:
        raise UserError(f"{path}: not a portable float map: its header is not like 'PF 1024 512 -1.0'")
    width, height, channels = int(match[2]), int(match[3]), 3 if match[1] == b"PF" else 1
    check_size(path, width, height)
    body = memoryview(data)[match.end() :]
    if len(body) < width * height * channels * 4:
        raise UserError(f"{path}: {len(body)} bytes of pixels are too few for {width} x {height}")
    stored = np.frombuffer(body, "<f4" if scale < 0 else ">f4", width * height * channels)
    pixels = stored.reshape(height, width, channels)[::-1].astype(np.float32)
    return np.repeat(pixels, 3, 2) if channels == 1 else pixels
