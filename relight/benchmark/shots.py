"""A photograph with its mask and square, and the same with changes that must not move what is inferred from it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from relight.photos.crop import MASK_THRESHOLD, Crop, crop_around

SHIFTS = (4, 8)  # network pixels
LARGER, SMALLER = 1.15, 0.93
KNEE, WAIST = 0.72, 0.5  # share of a standing figure's height above them
DARK = 0.5
WARM = np.array([1.2, 1.0, 1 / 1.2]) / 1.44  # white balance, dark enough to clip nothing more than before
PLAIN = 1 / 1.44  # the same exposure without it


@dataclass(frozen=True)
class Shot:
    """photo (H,W,3) uint8; mask (H,W) uint8, soft; square: the part of the photo on which maps are given."""

    photo: np.ndarray
    mask: np.ndarray
    square: Crop


def moved(box: Crop, down: float, right: float, larger: float = 1.0) -> Crop:
    """The square shifted by its own pixels and enlarged about its centre."""
    pixel, side = box.side / box.size, box.side * larger
    offset = (box.side - side) / 2
    return replace(box, top=box.top + down * pixel + offset, left=box.left + right * pixel + offset, side=side)


def variants(expose: Callable[[np.ndarray | float], np.ndarray], mask: np.ndarray, size: int) -> dict[str, Shot]:
    """Takes the photograph and the variants of it for which an answer should stay the same or follow.

    Args:
        expose: the photograph (H,W,3) uint8 for a gain on the light, a number or one for each channel.
        mask: of the figure, (H,W) uint8.
        size: pixels of the squares.

    Returns:
        Shots by name: the photograph itself "", and its variants under the names that `measures.invariances` reads.
    """
    photo, box = expose(1.0), crop_around(mask, size)
    shots = {"": Shot(photo, mask, box)}
    for pixels in SHIFTS:
        shots[f"down_{pixels}"] = Shot(photo, mask, moved(box, pixels, 0))
        shots[f"right_{pixels}"] = Shot(photo, mask, moved(box, 0, pixels))
    shots["larger"] = Shot(photo, mask, moved(box, 0, 0, LARGER))
    shots["smaller"] = Shot(photo, mask, moved(box, 0, 0, SMALLER))
    pixel = max(1, round(box.side / size))
    for name, change in (("fatter", binary_dilation), ("thinner", binary_erosion)):
        shots[name] = Shot(photo, change(mask >= MASK_THRESHOLD, iterations=pixel).astype(np.uint8) * 255, box)
    solid = np.flatnonzero((mask >= MASK_THRESHOLD).any(1))
    for name, share in (("knee", KNEE), ("waist", WAIST)):
        cut = mask.copy()
        cut[solid[0] + int(share * len(solid)) :] = 0
        shots[name] = Shot(photo, cut, crop_around(cut, size))
    shots["mirror"] = Shot(photo[:, ::-1], mask[:, ::-1], crop_around(mask[:, ::-1], size))
    for name, gain in (("dark", DARK), ("warm", WARM), ("plain", PLAIN)):
        shots[name] = Shot(expose(gain), mask, box)
    return shots
