"""The radiance of a panorama of any layout along any direction, and its image in a photo's camera."""

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from relight.panoramas import Panorama
from relight.panoramas.projection import CUBE_FACES, cut_faces
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
    focal = max(shape) / 2 / np.tan(np.radians(FIELD_OF_VIEW / 2))  # in pixels of the photo
    sigma = max(np.radians(blur), 0.5 * pixel_angle(panorama)) * focal
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
        box = (0, 0, width / step, height / step)
        channels = [Image.fromarray(np.ascontiguousarray(view[..., c])) for c in range(3)]
        view = np.stack([np.asarray(c.resize((width, height), Image.Resampling.BICUBIC, box)) for c in channels], -1)
    return np.maximum(view, 0)


def pixel_angle(panorama: Panorama) -> float:
    """Returns the angle between neighbouring pixels, radians, approximately."""
    height, width = panorama.pixels.shape[:2]
    across = {"latlong": width, "angular": width, "ball": width}.get(panorama.layout, 4 * np.sqrt(height * width / 6))
    return 2 * np.pi / across


def lookup(panorama: Panorama, directions: np.ndarray) -> np.ndarray:
    """Interpolates a panorama bilinearly: the inverse of its projection.

    Args:
        panorama: of any layout.
        directions: (...,3) of any length, in the frame of docs/conventions.md.

    Returns:
        The radiance (...,3) float32 that arrives from there.
    """
    directions = directions @ rotation_about_y(np.radians(panorama.yaw))
    if panorama.flip:
        directions = directions * np.array([-1, 1, 1])
    x, y, z = np.moveaxis(directions / np.linalg.norm(directions, axis=-1, keepdims=True), -1, 0)
    pixels, corners = panorama.pixels, panorama.corners  # whether the outermost samples lie on the image's edges
    match panorama.layout:
        case "latlong":
            if panorama.front == "+z":
                x, z = -x, -z
            longitude, polar = np.arctan2(x, -z) / (2 * np.pi) + 0.5, np.arctan2(np.hypot(x, z), y) / np.pi
            return _bilinear(pixels, polar, longitude, corners, wrap=True)
        case "angular":
            scale = np.arccos(np.clip(-z, -1, 1)) / np.pi / np.maximum(np.hypot(x, y), 1e-12)
            return _bilinear(pixels, (1 - y * scale) / 2, (1 + x * scale) / 2, corners)
        case "ball":
            scale = 0.5 / np.sqrt(np.maximum((1 + z) / 2, 1e-12))
            return _bilinear(pixels, (1 - y * scale) / 2, (1 + x * scale) / 2, corners)
    out = np.zeros((*x.shape, 3), np.float32)
    nearest = np.full(x.shape, -np.inf)
    faces = cut_faces(pixels, panorama.layout)
    for name in faces:  # a direction meets the face whose axis is nearest
        nearest = np.maximum(nearest, np.stack([x, y, z], -1) @ np.array(CUBE_FACES[name][0], float))
    for name, face in faces.items():
        axis, right, down = np.array(CUBE_FACES[name], float)
        on = np.stack([x, y, z], -1) @ axis >= nearest
        d = np.stack([x[on], y[on], z[on]], -1)
        depth = d @ axis
        out[on] = _bilinear(face, (1 + d @ down / depth) / 2, (1 + d @ right / depth) / 2, corners)
    return out


def _bilinear(pixels: np.ndarray, v: np.ndarray, u: np.ndarray, corners: bool, wrap: bool = False) -> np.ndarray:
    """Interpolates an image.

    Args:
        pixels: (H,W,C).
        v: (...) in [0,1] from the top to the bottom of the image.
        u: (...) in [0,1] from left to right.
        corners: whether the outermost samples lie on the edges of the image.
        wrap: whether its left and right edges meet.

    Returns:
        (...,C) float32.
    """
    height, width = pixels.shape[:2]
    row = v * (height - 1) if corners else v * height - 0.5
    column = u * (width - 1) if corners else u * width - 0.5
    row = np.clip(row, 0, height - 1)
    if not wrap:
        column = np.clip(column, 0, width - 1)
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    dv, du = (row - top)[..., None], (column - left)[..., None]
    bottom = np.minimum(top + 1, height - 1)
    left, right = (left % width, (left + 1) % width) if wrap else (left, np.minimum(left + 1, width - 1))
    upper = pixels[top, left] * (1 - du) + pixels[top, right] * du
    lower = pixels[bottom, left] * (1 - du) + pixels[bottom, right] * du
    return (upper * (1 - dv) + lower * dv).astype(np.float32)
