"""What a photo's camera sees of a panorama."""

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from relight.panoramas import Panorama
from relight.panoramas.lookup import lookup
from relight.sh import rotation_about_y

FIELD_OF_VIEW = 50.0  # degrees along the longer side of a photo: a 38 mm lens on 35 mm film


def camera_view(panorama: Panorama, shape: tuple[int, int], turn: float = 0.0, blur: float = 0.0) -> np.ndarray:
    """Renders a panorama as the photo's camera sees it.

    The camera stands on +z, looks along -z and has FIELD_OF_VIEW along its longer side.

    Args:
        panorama: of any layout.
        shape: (H, W) of the photo.
        turn: radians by which the panorama is rotated about the vertical axis, as the light is
            (relight.sh.rotation_about_y).
        blur: standard deviation in degrees; at least half a pixel of the panorama, so that pixels of small panoramas
            do not show.

    Returns:
        (H,W,3) float32, linear, in the panorama's unit.
    """
    height, width = shape
    focal = focal_length(shape)
    rows, columns = panorama.pixels.shape[:2]
    around = columns if panorama.layout in ("latlong", "angular", "ball") else 4 * np.sqrt(rows * columns / 6)
    sigma = max(np.radians(blur), np.pi / around) * focal
    step = max(1, int(sigma / 3))  # a blurred view has no detail: fewer pixels will do
    y, x = np.meshgrid(
        (height / 2 - np.arange(step / 2, height + step / 2, step)) / focal,
        (np.arange(step / 2, width + step / 2, step) - width / 2) / focal,
        indexing="ij",
    )
    directions = np.stack([x, y, np.full_like(x, -1.0)], -1)
    view = lookup(panorama, directions @ rotation_about_y(turn))  # R^T d: the direction before the turn
    if sigma > 1:
        view = gaussian_filter(view, (sigma / step, sigma / step, 0), mode="nearest")
    if step > 1:
        view = resized(view, shape, (width / step, height / step))
    return np.maximum(view, 0)


def blurred(view: np.ndarray, blur: float) -> np.ndarray:
    """Returns a view (H,W,3) float32 of a photo's camera, linear, blurred by a standard deviation in degrees."""
    height, width, _ = view.shape
    sigma = np.radians(blur) * focal_length((height, width))
    step = max(1, int(sigma / 3))  # a blurred view has no detail: fewer pixels will do
    small = resized(view, (-(-height // step), -(-width // step)))
    small = gaussian_filter(small, (sigma / step, sigma / step, 0), mode="nearest")
    return np.maximum(resized(small, (height, width)), 0)


def resized(
    view: np.ndarray, shape: tuple[int, int], extent: tuple[float, ...] = (), method: int = Image.Resampling.BICUBIC
) -> np.ndarray:
    """Resizes a view (h,w,C) to `shape` (H, W), float32, or its upper left part of this `extent` (width, height)."""
    width, height = extent or view.shape[1::-1]
    planes = (Image.fromarray(np.ascontiguousarray(plane, np.float32)) for plane in np.moveaxis(view, -1, 0))
    return np.stack([np.asarray(plane.resize(shape[::-1], method, (0, 0, width, height))) for plane in planes], -1)


def focal_length(shape: tuple[int, int]) -> float:
    """Returns the focal length of a photo (H,W), pixels."""
    return float(max(shape) / 2 / np.tan(np.radians(FIELD_OF_VIEW / 2)))
