"""Integrals over the sphere that are exact for polynomials."""

from collections.abc import Callable

import numpy as np

from relight.sh.basis import basis


def sphere(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) and weights (N,), sum 4 pi, that integrate polynomials up to `degree` in x, y, z exactly.

    Gauss-Legendre in z times equal steps of azimuth.
    """
    z, wz = np.polynomial.legendre.leggauss(degree // 2 + 1)
    azimuth = 2 * np.pi * np.arange(degree + 1) / (degree + 1)
    s = np.sqrt(1 - z * z)[:, None]
    directions = np.stack(np.broadcast_arrays(s * np.cos(azimuth), s * np.sin(azimuth), z[:, None]), -1)
    weights = np.repeat(wz * 2 * np.pi / (degree + 1), degree + 1)
    return directions.reshape(-1, 3), weights


def project_function(radiance: Callable[[np.ndarray], np.ndarray], order: int = 2, degree: int = 200) -> np.ndarray:
    """Coefficients (K, C) of `radiance`, which maps unit directions (N, 3) to (N, C).

    Exact for polynomials whose degree is at most `degree` - `order`; otherwise as good as the function is smooth.
    """
    directions, weights = sphere(degree)
    return basis(directions, order).T @ (weights[:, None] * radiance(directions))
