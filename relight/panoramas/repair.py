"""Repair of pixels that are not finite."""

from pathlib import Path

import numpy as np

from relight.files import UserError

ROWS = 64  # tested at a time
MAX_SHARE = 0.01  # of the pixels: a picture with more is broken
NEIGHBOURS = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j])


def repair_pixels(path: Path, pixels: np.ndarray, repair: bool) -> list[str]:
    """Replaces pixels that have a channel that is not finite, in place.

    A pixel gets the mean of those of its eight neighbours that are finite; larger holes are filled from their rim
    inward.

    Args:
        path: for error messages.
        pixels: (H,W,3).
        repair: whether to replace them; if not, one such pixel is an error.

    Returns:
        The repair as a sentence, or nothing.

    Raises:
        UserError: if there are such pixels and `repair` is off, or if they are more than MAX_SHARE.
    """
    rows = []
    for start in range(0, len(pixels), ROWS):
        finite = np.isfinite(pixels[start : start + ROWS])
        if not finite.all():  # hardly any picture gets here; the reduction by pixels takes ten times as long
            rows.append(np.argwhere(~finite.all(-1)) + [start, 0])
    if not rows:
        return []
    holes = np.concatenate(rows)
    height, width = pixels.shape[:2]
    count = f"{len(holes)} of {height * width} pixels are not finite numbers"
    if not repair:
        raise UserError(
            f"{path}: {count}, the first in row {holes[0, 0]}, column {holes[0, 1]} (a sun can be too bright for half "
            "floats); relight light --repair, or panoramas.repair=true, puts the mean of their neighbours there"
        )
    if len(holes) > MAX_SHARE * height * width:
        raise UserError(f"{path}: {count}; more than {MAX_SHARE:.0%} cannot be repaired, get the file anew")
    fill(pixels, holes)
    return [f"{count}; each has the mean of its neighbours now"]


def fill(pixels: np.ndarray, holes: np.ndarray) -> None:
    """Fills holes (N,2), rows and columns, of pixels (H,W,3), in place and ring by ring."""
    size = np.array(pixels.shape[:2])
    known = np.ones(size, bool)
    known[tuple(holes.T)] = False
    while len(holes):
        near = holes[:, None] + NEIGHBOURS
        inside = ((near >= 0) & (near < size)).all(-1)
        row, column = np.moveaxis(np.clip(near, 0, size - 1), -1, 0)
        good = inside & known[row, column]
        rim = good.any(1)
        weight = good[rim, :, None] / good[rim].sum(1)[:, None, None]
        around = np.where(good[rim, :, None], pixels[row[rim], column[rim]], 0)
        pixels[tuple(holes[rim].T)] = (weight * around).sum(1)
        known[tuple(holes[rim].T)] = True
        holes = holes[~rim]
