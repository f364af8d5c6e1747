"""Photographs with mask and square, and variants of them that test the invariances of a method."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from relight.maps.square import MASK_THRESHOLD, Crop, crop_around, extent

SHIFTS = (4, 8)  # pixels of the square
LARGER, SMALLER = 1.15, 0.93  # factors on the side of the square
KNEE, WAIST = 0.72, 0.5  # fractions of a standing figure's height, from the top
DARK = 0.5  # exposure
WARM_RED_PER_BLUE = 1.44  # of WARM
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


def _shift_and_scale(box: Crop, down: float, right: float, scale: float = 1.0) -> Crop:
    """Moves a square by pixels of its own, and scales its side about its centre."""
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
        Shots by name: "" is the photograph itself. In down_4, down_8, right_4, right_8, larger and smaller the square
        is moved or scaled; in fatter and thinner the mask has another outline; knee and waist have a mask that ends
        there, and its square; mirror is the mirror image; dark, warm and plain have other gains.
    """
    photo, box = expose(1.0), crop_around(mask, size)  # a gain of 1
    shots = {"": Shot(photo, mask, box)}
    for pixels in SHIFTS:
        shots[f"down_{pixels}"] = Shot(photo, mask, _shift_and_scale(box, down=pixels, right=0))
        shots[f"right_{pixels}"] = Shot(photo, mask, _shift_and_scale(box, down=0, right=pixels))
    for name, factor in (("larger", LARGER), ("smaller", SMALLER)):
        shots[name] = Shot(photo, mask, _shift_and_scale(box, down=0, right=0, scale=factor))
    pixel_of_square = max(1, round(box.side / size))  # in pixels of the photo
    for name, change in (("fatter", binary_dilation), ("thinner", binary_erosion)):
        changed = change(mask >= MASK_THRESHOLD, iterations=pixel_of_square)
        shots[name] = Shot(photo, changed.astype(np.uint8) * 255, box)
    (top, bottom), _ = extent(mask >= MASK_THRESHOLD)
    for name, share in (("knee", KNEE), ("waist", WAIST)):
        cut = mask.copy()
        cut[top + int(share * (bottom - top)) :] = 0
        shots[name] = Shot(photo, cut, crop_around(cut, size))
    shots["mirror"] = Shot(photo[:, ::-1], mask[:, ::-1], crop_around(mask[:, ::-1], size))
    for name, gain in (("dark", DARK), ("warm", WARM), ("plain", PLAIN)):
        shots[name] = Shot(expose(gain), mask, box)
    return shots
