"""The edge of a mask, fitted to the photo's colors.

Drawn and automatic masks are a few pixels off, and masks of two values have no soft edge at all. Relit by such a mask,
a rim of background changes with the person, or a rim of the person keeps the old light. Near the edge a pixel is
a F + (1 - a) B, where F and B are the mean colors of what is surely person and surely background nearby. The coverage a
is a compromise between the one that explains the pixel best and the mask's, which counts more the more F and B vary and
the less of them is seen.

A soft mask that is given, such as a matte, says more than that, and is never altered.
"""

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

from relight.core.srgb import to_linear
from relight.maps.square import MASK_THRESHOLD, extent

CELLS = 400  # along the longer side of the people's box, of 2 pixels or more; one or two along the edge are unsure
SURE = 13  # codes from 0 and 255 within which coverage is none and all
WINDOW = 7  # cells across, over which the two colors are averaged
PRIOR = 0.3  # standard deviation of the mask's coverage along its edge
NOISE = 0.02  # standard deviation of linear values
SPREAD = 5.0  # weight of the variance of the two colors
STEEP = 1.1  # coverage of less than 4.5 % is noise, and none
HALF = 77  # codes from 0 and 255 beyond which coverage is fractional
SOFT = 0.025  # share of them along a soft edge; soft hair alone has 0.033, two values in the worst JPEG have 0.024
ENOUGH = 1 / 30  # product of the shares of sure cells in a window, from which they count in full


def fit_edge(pixels: np.ndarray, coverage: np.ndarray, automatic: bool = False) -> np.ndarray:
    """Fits the edge of a mask to the colors of a photo, unless it is a soft mask that was given.

    Args:
        pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709.
        coverage: (H,W) uint8 of all people, not empty.
        automatic: whether a network made the mask, so that its soft edge is no more than a guess.

    Returns:
        (H,W) uint8; the mask's where person and background have the same color, or one of them is not seen nearby.
    """
    if not automatic:
        if is_soft(coverage):
            return coverage
        coverage = np.where(coverage >= MASK_THRESHOLD, np.uint8(255), np.uint8(0))
    box = extent(coverage > SURE)
    side = max(round(max(last - first for first, last in box) / CELLS), 2)
    part = tuple(slice(max(first - WINDOW * side, 0), last + WINDOW * side) for first, last in box)
    out = coverage.copy()
    share = out[part]
    if not ((share > 0) & (share < 255)).any():
        share[:] = uniform_filter(share, 3, mode="nearest")
    starts = [np.arange(0, length, side) for length in share.shape]
    low, high = (
        extreme.reduceat(extreme.reduceat(share, starts[0], axis=0), starts[1], axis=1)
        for extreme in (np.minimum, np.maximum)
    )
    sure = (minimum_filter(low, 3, mode="nearest") > 255 - SURE, maximum_filter(high, 3, mode="nearest") < SURE)
    seen = [uniform_filter(cells.astype(np.float32), WINDOW, mode="nearest") for cells in sure]
    trust = np.minimum(seen[0] * seen[1] / np.float32(ENOUGH), 1) ** 2
    unsure = ~sure[0] & ~sure[1] & (trust > 1e-3)
    y, x = np.nonzero(unsure.repeat(side, 0).repeat(side, 1)[: share.shape[0], : share.shape[1]])
    cell = y // side * unsure.shape[1] + x // side
    given = share[y, x] / np.float32(255)
    near = maximum_filter(unsure, WINDOW)
    missing = [(0, -length % side) for length in share.shape]  # border pixels complete the last cells
    padded = np.pad(pixels[part], [*missing, (0, 0)], mode="edge")
    cells = to_linear(padded.reshape(len(near), side, -1, side, 3).swapaxes(1, 2)[near])  # (n,side,side,3)
    means = np.zeros((2, *near.shape, 3), np.float32)  # of values and of their squares
    means[:, near] = cells.mean((1, 2)), (cells**2).mean((1, 2))
    (front, behind), squares = (
        [
            uniform_filter(mean * known[..., None], (WINDOW, WINDOW, 1), mode="nearest")
            / np.maximum(count, np.float32(1e-4))[..., None]
            for known, count in zip(sure, seen)
        ]
        for mean in means
    )
    variance = sum(np.maximum(a - b**2, 0).sum(-1) for a, b in zip(squares, (front, behind)))
    front, behind = (colors.reshape(-1, 3)[cell] for colors in (front, behind))
    along, across = ((a * (front - behind)).sum(-1) for a in (to_linear(pixels[part][y, x]) - behind, front - behind))
    doubt = (NOISE**2 + SPREAD * variance.take(cell)) / (PRIOR**2 * trust.take(cell))
    fitted = (along + doubt * given) / (across + doubt)
    share[y, x] = np.rint(255 * np.clip((fitted - 0.5) * STEEP + 0.5, 0, 1))
    return out


def is_soft(coverage: np.ndarray) -> bool:
    """Returns whether a mask (H,W) uint8 has fractional values along its edge, more than coders leave in two values."""
    box = tuple(slice(max(first - 1, 0), last + 1) for first, last in extent(coverage >= MASK_THRESHOLD))
    share = coverage[box]
    fractional = (share > HALF) & (share < 255 - HALF)
    if not fractional.any():
        return False
    edge = (maximum_filter(share, 3) >= MASK_THRESHOLD) & (minimum_filter(share, 3) < MASK_THRESHOLD)
    return bool(fractional[edge].sum() > SOFT * edge.sum())
