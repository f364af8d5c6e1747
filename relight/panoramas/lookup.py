"""The radiance of a panorama of any layout along any direction."""

import numpy as np

from relight.panoramas.panorama import Panorama
from relight.panoramas.projection import CUBE_FACES, cut_faces
from relight.sh import rotation_about_y


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
        case "angular" | "ball":
            polar = np.arccos(np.clip(z, -1, 1))
            radius = np.sin(polar / 2) if panorama.layout == "ball" else 1 - polar / np.pi
            side = np.where((x == 0) & (y == 0), 1, x)  # the whole rim is one direction
            scale = radius / np.hypot(side, y)
            return _bilinear(pixels, (1 - y * scale) / 2, (1 + side * scale) / 2, corners)
    points, out = np.stack([x, y, z], -1), np.zeros((*x.shape, 3), np.float32)
    faces = cut_faces(pixels, panorama.layout)
    depths = points @ np.array([CUBE_FACES[name][0] for name in faces], float).T  # along the axis of each face
    for i, (name, face) in enumerate(faces.items()):
        _, right, down = np.array(CUBE_FACES[name], float)
        on = depths[..., i] >= depths.max(-1)  # a direction meets the face whose axis is nearest
        d, depth = points[on], depths[on, i]
        out[on] = _bilinear(face, (1 + d @ down / depth) / 2, (1 + d @ right / depth) / 2, corners)
    return out


def _bilinear(pixels: np.ndarray, v: np.ndarray, u: np.ndarray, corners: bool, wrap: bool = False) -> np.ndarray:
    """Interpolates an image.

    `v` and `u` (...) are in [0,1] from the top and from the left of `pixels` (H,W,C); the result is (...,C) float32.
    With `corners`, the outermost samples lie on the edges of the image; with `wrap`, its left and right edges meet.
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
