"""Irradiance of a light in spherical harmonics on surfaces that nothing occludes."""

import numpy as np

from relight.sh.basis import basis, cosine_factors, order_of, per_coefficient


def unoccluded(normals: np.ndarray, order: int = 2) -> np.ndarray:
    """The transport of an open surface, T_lm(n) = A_l Y_lm(n): `normals` (..., 3) unit, to (..., K) float64.

    No 1/pi: unoccluded(n)[0] = pi * .282095 = .8862 (method.md section 1).
    """
    return basis(normals, order) * per_coefficient(cosine_factors(order))


def irradiance(light: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """E(n) = sum A_l L_lm Y_lm(n) of radiance coefficients `light` (..., K, C) at unit `normals` (N, 3) or (3,).

    Returns (..., N, C) or (..., C); may be slightly negative, which is the truncated series and not an error.
    """
    light = np.asarray(light, np.float64)
    return unoccluded(normals, order_of(light.shape[-2])) @ light
