"""From a panorama to a light: radiance coefficients in spherical harmonics."""

import numpy as np

from relight.panoramas.layouts import (
    angular_to_sphere,
    ball_to_sphere,
    cut_faces,
    project_cube,
    project_latlong,
    project_plane,
)
from relight.panoramas.panorama import Panorama
from relight.sh import order_of, rotate_y, rotation_matrix

MIRROR = np.diag([-1.0, 1.0, 1.0])


def project(panorama: Panorama, order: int = 2) -> np.ndarray:
    """The light of a panorama: (K, 3) float64 radiance coefficients, without A_l, in the camera frame."""
    pixels, corners = panorama.pixels, panorama.corners
    match panorama.layout:
        case "latlong":
            light = project_latlong(pixels, order, corners)
            if panorama.front == "+z":
                light = rotate_y(light, np.pi)
        case "angular":
            light = project_plane(pixels, angular_to_sphere, order, corners, disc=True)
        case "ball":
            light = project_plane(pixels, ball_to_sphere, order, corners, disc=True)
        case _:
            light = project_cube(cut_faces(pixels, panorama.layout), order, corners)
    return orient(light, panorama.yaw, panorama.flip)


def orient(light: np.ndarray, yaw: float = 0.0, flip: bool = False) -> np.ndarray:
    """`light` (K, C) mirrored left to right if `flip`, then turned by `yaw` degrees, +z toward +x for yaw > 0."""
    if flip:
        light = rotation_matrix(MIRROR, order_of(len(light))) @ light
    return rotate_y(light, np.radians(yaw)) if yaw else light
