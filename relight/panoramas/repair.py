"""Repair of pixels that are not finite, and of suns whose red and green are lost."""

from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation, convolve, label

from relight.core.errors import UserError

LOST = 1e-3  # of the mean red: a pixel with less has none
MAX_SHARE = 0.01  # of the pixels; a picture with more is broken


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
    finite = np.isfinite(pixels)
    if finite.all():  # ten times as fast as testing each pixel, and nearly always enough
        return []
    known = finite.all(-1)
    holes = np.argwhere(~known)
    height, width = pixels.shape[:2]
    count = f"{len(holes)} of {height * width} pixels are not finite numbers"
    if not repair:
        first = f"the first in row {holes[0, 0]}, column {holes[0, 1]}"
        raise UserError(f"{path}: {count}, {first}; relight light --repair, or panoramas.repair=true, replaces them")
    if len(holes) > MAX_SHARE * height * width:
        raise UserError(f"{path}: {count}; more than {MAX_SHARE:.0%} cannot be repaired: download the file again")
    pixels[~known] = 0
    while not known.all():  # ring by ring
        weight = convolve(known.astype(np.float32), np.ones((3, 3)), mode="constant")
        rim = ~known & (weight > 0)
        for channel in range(3):
            pixels[rim, channel] = convolve(pixels[..., channel], np.ones((3, 3)), mode="constant")[rim] / weight[rim]
        known |= rim
    return [f"{count}; they were replaced by the mean of their neighbours"]


def repair_sun(path: Path, pixels: np.ndarray, repair: bool) -> list[str]:
    """Rebuilds a sun that has blue and no red, in place: its blue, at least that of the rim, in the color of the rim.

    Red and green of a sun can be too bright for the floats of a file while blue is not. Left so, it lights in violet.

    Args:
        path: for the note.
        pixels: (H,W,3).
        repair: whether to rebuild it.

    Returns:
        The repair, or what is wrong, as one sentence; an empty list for other pixels.
    """
    brightest = np.unravel_index(pixels[..., 2].argmax(), pixels.shape[:2])
    lost = pixels[..., 0] <= LOST * pixels[..., 0].mean()
    if not lost[brightest] or pixels[brightest][2] < pixels.max():
        return []
    middle = pixels.shape[1] // 2
    to_middle = middle - brightest[1]  # of columns, since the left and right edges of a lat-long meet
    parts, _ = label(np.roll(lost, to_middle, 1), np.ones((3, 3)))
    sun = parts == parts[brightest[0], middle]
    around = np.roll(binary_dilation(sun, np.ones((3, 3))) & ~sun, -to_middle, 1)
    block = np.roll(sun, -to_middle, 1)
    rim = pixels[around].mean(0) if around.any() else np.zeros(3)
    if rim.min() <= 0:  # a blue lamp in the dark
        return []
    if not repair:
        what = "the brightest pixel has blue and no red, like a sun whose red is lost"
        return [f"{path}: {what}; relight light --repair, or panoramas.repair=true, rebuilds it"]
    pixels[block] = np.maximum(pixels[block][:, 2:], rim[2]) * (rim / rim[2])
    return [f"a sun of {block.sum()} pixels had lost its red and green; it was rebuilt in the color of its rim"]
