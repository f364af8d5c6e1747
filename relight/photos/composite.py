"""Putting a relit figure before a background, through a soft mask and without a halo.

All in linear values, in strips of rows, so that an 8k photo needs no more than a few of them.
"""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import uniform_filter1d

WIDE, NARROW = 45, 6  # radii of the two passes, pixels: hair, then detail
REACH = WIDE + NARROW  # rows beyond a strip that its result depends on
STRIP = 512  # rows


def strips(first: int, last: int) -> Iterator[tuple[int, int]]:
    """[first, last) cut into runs of at most STRIP rows."""
    for row in range(first, last, STRIP):
        yield row, min(row + STRIP, last)


def foreground(linear: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """The figure's own colour (H,W,3) at each pixel of `linear` (H,W,3), whose coverage is `alpha` (H,W) in [0,1].

    A pixel of a soft edge shows alpha F + (1 - alpha) B; relighting it as if it were all F carries the old background
    along, which is the halo. F and B are first taken as local means of the two sides, then corrected so that together
    they give the pixel; two passes, wide and narrow (Forte, "Approximate fast foreground colour estimation", 2021).
    Pixels with alpha 1 stay as they are.
    """
    soft = (alpha > 0) & (alpha < 1)
    if not soft.any():
        return linear
    rows, columns = (np.flatnonzero(soft.any(axis)) for axis in (1, 0))
    part = np.s_[
        max(rows[0] - REACH, 0) : rows[-1] + 1 + REACH,
        max(columns[0] - REACH, 0) : columns[-1] + 1 + REACH,
    ]
    near, a = linear[part], alpha[part][..., None]
    figure, behind = near, near
    for radius in (WIDE, NARROW):
        mean_figure = _mean(figure * a, radius) / np.maximum(_mean(a, radius), 1e-4)
        mean_behind = _mean(behind * (1 - a), radius) / np.maximum(_mean(1 - a, radius), 1e-4)
        error = near - a * mean_figure - (1 - a) * mean_behind
        figure = np.maximum(mean_figure + a * error, 0)
        behind = mean_behind
    out = linear.copy()
    out[part] = np.where(soft[part][..., None], figure, near)
    return out


def over(figure: np.ndarray, alpha: np.ndarray, background: np.ndarray) -> np.ndarray:
    """alpha F + (1 - alpha) B, all linear; alpha (H,W) in [0,1]."""
    return background + alpha[..., None] * (figure - background)


def _mean(image: np.ndarray, radius: int) -> np.ndarray:
    for axis in (0, 1):
        image = uniform_filter1d(image, 2 * radius + 1, axis=axis, mode="nearest")
    return image
