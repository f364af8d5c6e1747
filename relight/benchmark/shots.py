"""Photographs with mask and square, and variants of them that test the invariances of a method."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from relight.crop import MASK_THRESHOLD, Crop, crop_around, extent

SHIFTS = (4, 8)  # pixels of the square
LARGER, SMALLER = 1.15, 0.93  # factors on the side of the square
KNEE, WAIST = 0.72, 0.5  # fractions of a standing figure's height, from the top
DARK = 0.5  # exposure
WARM = np.array([1.2, 1.0, 1 / 1.2]) / 1.44  # white balance; dark enough to clip no further pixels
PLAIN = 1 / 1.44  # neutral, at the exposure of WARM


@dataclass(frozen=True)
class Shot:
    """A photograph as methods get it.

    Attributes:
        photo: (H,W,3) uint8 sRGB.
        mask: (H,W) uint8, with soft edges.
        square: the part of the photo on which maps are compared.
    """

    photo: np.ndarray
    mask: np.ndarray
    square: Crop


def shift_and_scale(box: Crop, down: float, right: float, scale: float = 1.0) -> Crop:
    """Returns a square shifted by its own pixels and scaled about its centre."""
    pixel, side = box.side / box.size, box.side * scale
    offset = (box.side - side) / 2
    return replace(box, top=box.top + down * pixel + offset, left=box.left + right * pixel + offset, side=side)


def variants(expose: Callable[[np.ndarray | float], np.ndarray], mask: np.ndarray, size: int) -> dict[str, Shot]:
    """Returns a photograph and its variants.

    Args:
        expose: returns the photograph (H,W,3) uint8 for a gain on the light, a number or (3,).
        mask: (H,W) uint8 of the figure.
        size: pixels of the squares.

    Returns:
        Shots by name: "" is the photograph itself, the others are named as in `measures.invariances`.
    """
    photo, box = expose(1.0), crop_around(mask, size)
    shots = {"": Shot(photo, mask, box)}
    for pixels in SHIFTS:
        shots[f"down_{pixels}"] = Shot(photo, mask, shift_and_scale(box, pixels, 0))
        shots[f"right_{pixels}"] = Shot(photo, mask, shift_and_scale(box, 0, pixels))
    shots["larger"] = Shot(photo, mask, shift_and_scale(box, 0, 0, LARGER))
    shots["smaller"] = Shot(photo, mask, shift_and_scale(box, 0, 0, SMALLER))
    pixel = max(1, round(box.side / size))
    for name, change in (("fatter", binary_dilation), ("thinner", binary_erosion)):
        shots[name] = Shot(photo, change(mask >= MASK_THRESHOLD, iterations=pixel).astype(np.uint8) * 255, box)
    (top, bottom), _ = extent(mask >= MASK_THRESHOLD)
    for name, share in (("knee", KNEE), ("waist", WAIST)):
        cut = mask.copy()
        cut[top + int(share * (bottom - top)) :] = 0
        shots[name] = Shot(photo, cut, crop_around(cut, size))
    shots["mirror"] = Shot(photo[:, ::-1], mask[:, ::-1], crop_around(mask[:, ::-1], size))
    for name, gain in (("dark", DARK), ("warm", WARM), ("plain", PLAIN)):
        shots[name] = Shot(expose(gain), mask, box)
    return shots
