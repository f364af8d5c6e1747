"""Rotation of lights in spherical harmonics, exact about any axis and at any order."""

import numpy as np

from relight.sh.basis import bands, basis, order_of
from relight.sh.quadrature import sphere


def rotation_matrix(rotation: np.ndarray, order: int = 2) -> np.ndarray:
    """(K, K) matrix M with coefficients' = M @ coefficients when the light itself is turned by `rotation` (3, 3).

    M_jk is the integral of Y_j(w) Y_k(R^T w), a polynomial of degree 2 * order, so quadrature is exact. An improper
    `rotation` (a mirror) is as good.
    """
    directions, weights = sphere(2 * order)
    matrix = basis(directions, order).T @ (weights[:, None] * basis(directions @ rotation, order))
    band = bands(order)
    return np.where(band[:, None] == band, matrix, 0.0)  # bands do not mix: what the sum left there is rounding


def about_y(angle: float) -> np.ndarray:
    """The (3, 3) rotation by `angle` radians about the vertical, +z toward +x for angle > 0."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """The (3, 3) right-handed rotation by `angle` radians about `axis` (3,), any length (Rodrigues)."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def rotate_y(light: np.ndarray, angle: float) -> np.ndarray:
    """`light` (..., K, C) turned by `angle` radians about the vertical, +z toward +x for angle > 0."""
    light = np.asarray(light)
    return rotation_matrix(about_y(angle), order_of(light.shape[-2])) @ light
