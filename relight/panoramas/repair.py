"""Repair of pixels that are not finite."""

from pathlib import Path

import numpy as np

from relight.errors import UserError

ROWS = 64  # rows that are tested at a time
MAX_SHARE = 0.01  # of the pixels; a picture with more is broken
NEIGHBOUR_OFFSETS = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j])


def repair_pixels(path: Path, pixels: np.ndarray, repair: bool) -> list[str]:
    """Replaces pixels with non-finite channels in place, by the mean of their finite neighbours (of eight).

    Larger holes are filled from the rim inward.

    Args:
        path: for error messages.
        pixels: (H,W,3).
        repair: whether to replace them; otherwise, one such pixel is an error.

    Returns:
        The repair as one sentence, or an empty list.

    Raises:
        UserError: if there are such pixels and `repair` is false, or if they are more than MAX_SHARE.
    """
    rows = []
    for start in range(0, len(pixels), ROWS):
        finite = np.isfinite(pixels[start : start + ROWS])
        if not finite.all():  # ten times as fast as testing each pixel, and nearly always enough
            rows.append(np.argwhere(~finite.all(-1)) + [start, 0])
    if not rows:
        return []
    holes = np.concatenate(rows)
    height, width = pixels.shape[:2]
    count = f"{len(holes)} of {height * width} pixels are not finite numbers"
    if not repair:
        raise UserError(
            f"{path}: {count}, the first in row {holes[0, 0]}, column {holes[0, 1]} (a sun can be too bright for half "
            "floats); relight light --repair, or panoramas.repair=true, replaces them by the mean of their neighbours"
        )
    if len(holes) > MAX_SHARE * height * width:
        raise UserError(f"{path}: {count}; more than {MAX_SHARE:.0%} cannot be repaired: download the file again")
    fill_holes(pixels, holes)
    return [f"{count}; they were replaced by the mean of their neighbours"]


def fill_holes(pixels: np.ndarray, holes: np.ndarray) -> None:
    """Fills holes in pixels (H,W,3) in place, ring by ring.

    Args:
        pixels: (H,W,3).
        holes: (N,2) rows and columns.
    """
    size = np.array(pixels.shape[:2])
    known = np.ones(size, bool)
    known[tuple(holes.T)] = False
    while len(holes):
        neighbours = holes[:, None] + NEIGHBOUR_OFFSETS
        inside = ((neighbours >= 0) & (neighbours < size)).all(-1)
        row, column = np.moveaxis(np.clip(neighbours, 0, size - 1), -1, 0)
        usable = inside & known[row, column]
        rim = usable.any(1)
        weight = usable[rim, :, None] / usable[rim].sum(1)[:, None, None]
        values = np.where(usable[rim, :, None], pixels[row[rim], column[rim]], 0)
        pixels[tuple(holes[rim].T)] = (weight * values).sum(1)
        known[tuple(holes[rim].T)] = True
        holes = holes[~rim]
