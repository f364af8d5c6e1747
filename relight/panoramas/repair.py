"""Pixels that are not numbers: refused, or on request replaced by the mean of their neighbours."""

from pathlib import Path

import numpy as np

from relight.files import UserError

ROWS = 64  # looked at together
MOST = 0.01  # share of the pixels: a picture with more is broken, and a guess at them would be no light
AROUND = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j])


def mend(path: Path, pixels: np.ndarray, repair: bool) -> list[str]:
    """Finds pixels of (H, W, 3) with a channel that is not finite and, with `repair`, replaces them in place.

    A pixel takes the mean, of all channels, of those of its eight neighbours that are finite; larger holes are filled
    so from their rim inward. Returns what was done, a sentence or none. UserError, which names their number, when
    there are such pixels and no `repair`, or more than MOST.
    """
    rows = []
    for start in range(0, len(pixels), ROWS):
        finite = np.isfinite(pixels[start : start + ROWS])
        if not finite.all():  # nearly no picture gets here: to reduce by pixels takes ten times as long
            rows.append(np.argwhere(~finite.all(-1)) + [start, 0])
    if not rows:
        return []
    holes = np.concatenate(rows)
    height, width = pixels.shape[:2]
    found = f"{len(holes)} of {height * width} pixels are not finite numbers"
    if not repair:
        raise UserError(
            f"{path}: {found}, the first in row {holes[0, 0]}, column {holes[0, 1]} (a sun can be too bright for half "
            "floats); relight light --repair, or panoramas.repair=true, puts the mean of their neighbours there"
        )
    if len(holes) > MOST * height * width:
        raise UserError(f"{path}: {found}; more than {MOST:.0%} cannot be repaired, get the file anew")
    fill(pixels, holes)
    return [f"{found}; each has the mean of its neighbours now"]


def fill(pixels: np.ndarray, holes: np.ndarray) -> None:
    """Fills `holes` (N, 2), rows and columns, of pixels (H, W, 3) in place, ring by ring."""
    size = np.array(pixels.shape[:2])
    known = np.ones(size, bool)
    known[tuple(holes.T)] = False
    while len(holes):
        near = holes[:, None] + AROUND
        inside = ((near >= 0) & (near < size)).all(-1)
        row, column = np.moveaxis(np.clip(near, 0, size - 1), -1, 0)
        good = inside & known[row, column]
        rim = good.any(1)
        weight = good[rim, :, None] / good[rim].sum(1)[:, None, None]
        around = np.where(good[rim, :, None], pixels[row[rim], column[rim]], 0)
        pixels[tuple(holes[rim].T)] = (weight * around).sum(1)
        known[tuple(holes[rim].T)] = True
        holes = holes[~rim]
