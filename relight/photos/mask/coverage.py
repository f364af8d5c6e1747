"""From the values of a mask's file to coverage: soft masks, labels of segmentation programs, masks in one color."""

import numpy as np
from PIL import Image
from scipy.ndimage import maximum_filter, minimum_filter

from relight.core.errors import UserError

GREY = 24  # largest difference of channels that a coder leaves in a grey mask
FULL = 128  # least largest value of a mask that is no map of labels
SIMILAR = 40  # distance from the line between black and a color, that a coder leaves in a mask of this color
MOST_LABELS, EXACT = 64, 4  # colors of a map of labels; distance from the line in a mask that no coder has changed
LEAST_AREA = 0.002  # of the picture: smaller areas of one value may belong to a soft edge
WANTED = "it must be white on the person and black elsewhere"


def coverage_of(values: np.ndarray, what: str) -> tuple[np.ndarray, list[str]]:
    """Converts the values of a mask to coverage.

    Two values or colors are background and person: the background is black, or else the person is white or brighter.
    Shades of one color are coverage in that color.

    Args:
        values: (H,W) of any type, or (H,W,3) uint8.
        what: the mask's name in errors.

    Returns:
        Coverage (H,W) uint8; and what was chosen where the values can mean two things, one sentence each.

    Raises:
        UserError: if the values are labels of several things.
    """
    if values.ndim == 3:
        red, green, blue = (np.ascontiguousarray(values[..., channel]) for channel in range(3))
        spread = np.maximum(np.maximum(red, green), blue) - np.minimum(np.minimum(red, green), blue)
        if spread.max() > GREY:
            return _of_colors(values, what)
        values = np.asarray(Image.fromarray(values).convert("L")) if spread.any() else red
    notes = []
    if values.dtype.kind == "f":
        finite = np.isfinite(values)
        if not finite.all():
            notes.append(f"{what} has {int((~finite).sum())} values that are not numbers: they are treated as 0")
        values = np.where(finite, values, 0)
    # The histogram is ten times as fast.
    kinds = np.flatnonzero(Image.fromarray(values).histogram()) if values.dtype == np.uint8 else np.unique(values)
    low, high = kinds[0], kinds[-1]
    if low == high:
        return np.where(values >= _top(values, high), np.uint8(255), np.uint8(0)), notes
    if len(kinds) == 2:
        if (low, high) != (0, _top(values, high)):
            notes.append(f"{what} has the two values {low:g} and {high:g}: they are treated as 0 and 255")
        return np.where(values == high, np.uint8(255), np.uint8(0)), notes
    if values.dtype.kind in "iu" and high < FULL:
        raise UserError(f"{what} holds labels or shades from {low} to {high} of 255: {WANTED}")
    notes += _areas(values, kinds, what)
    if high < 0.98 * _top(values, high):
        notes.append(f"{what} is nowhere white: its largest value is {high:g}, so that nothing is covered in full")
    if values.dtype == np.uint8:
        return values, notes
    return np.round(np.maximum(values, 0) * (255 / _top(values, high))).astype(np.uint8), notes


def _areas(values: np.ndarray, kinds: np.ndarray, what: str) -> list[str]:
    """Notes on areas of a value between black and white: soft edges have no area of one, and maps of labels several."""
    if len(kinds) > MOST_LABELS:
        return []
    inner = maximum_filter(values, 3) == minimum_filter(values, 3)
    areas = [kind for kind in kinds[1:-1] if (inner & (values == kind)).mean() > LEAST_AREA]
    if len(areas) > 1:
        listed = ", ".join(f"{kind:g}" for kind in areas)
        raise UserError(f"{what} has areas of the values {listed}, as labels have: {WANTED}")
    return [f"{what} has areas of the value {kind:g}, which are taken as covered in part" for kind in areas]


def _top(values: np.ndarray, high: float) -> float:
    """Returns the value that means full coverage in a mask whose largest value is `high`."""
    return 255 if values.dtype == np.uint8 else max(float(high), 1.0)


def _of_colors(values: np.ndarray, what: str) -> tuple[np.ndarray, list[str]]:
    codes = (values.astype(np.int32) << [16, 8, 0]).sum(-1)
    used = np.unique(codes)
    if len(used) == 2:
        person = used.max() if 0 in used else 0xFFFFFF  # what is not black, else what is white
        if person not in used:
            both = " and ".join(f"#{code:06x}" for code in used)
            raise UserError(f"{what} has the two colors {both}, neither of which is black or white: {WANTED}")
        notes = [f"{what} has two colors: #{person:06x} is taken for the person"]
        return np.where(codes == person, np.uint8(255), np.uint8(0)), notes
    flat = values.reshape(-1, 3).astype(np.float32)
    brightest = flat[flat.max(-1).argmax()]
    share = flat @ brightest / (brightest @ brightest)
    if np.abs(flat - share[:, None] * brightest).max() > (EXACT if len(used) <= MOST_LABELS else SIMILAR):
        raise UserError(f"{what} has several colors, as if it is the photo itself or a map of labels: {WANTED}")
    if share.min() > 0.02:
        raise UserError(f"{what} has a background that is not black: {WANTED}")
    notes = [f"{what} is drawn in one color, which is taken for white"]
    return np.round(share.clip(0, 1) * 255).astype(np.uint8).reshape(values.shape[:2]), notes
