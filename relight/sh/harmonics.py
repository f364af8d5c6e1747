"""Real spherical harmonics: orthonormal, without the Condon-Shortley phase, index l*l + l + m, pole along +z.

K = (order + 1)^2 is the number of coefficients throughout (docs/conventions.md).
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from relight.core.errors import UserError

MAX_ORDER = 85  # above, (2 order)! overflows double precision, and harmonics would vanish
UNOCCLUDED_T00 = math.sqrt(math.pi) / 2  # T_00 of unoccluded points, its maximum: pi Y_00 = .8862


def coefficient_count(order: int) -> int:
    """Returns K, the number of coefficients up to and including band `order`; UserError above MAX_ORDER.

    >>> coefficient_count(2)
    9
    """
    if order > MAX_ORDER:
        raise UserError(f"order {order}: it must be at most {MAX_ORDER}")
    return (order + 1) ** 2


def order_of(coefficients: int) -> int:
    """Returns the order of a series with K coefficients.

    Raises:
        UserError: if K is not a square number.

    >>> order_of(9)
    2
    """
    order = math.isqrt(max(coefficients, 1)) - 1
    if coefficient_count(order) != coefficients:
        raise UserError(f"{coefficients} spherical-harmonic coefficients: a full set has 1, 4, 9, 16, 25 ... of them")
    return order


def bands(order: int) -> np.ndarray:
    """Returns the band l of each coefficient, (K,) int.

    >>> bands(2).tolist()
    [0, 1, 1, 1, 2, 2, 2, 2, 2]
    """
    return np.repeat(np.arange(order + 1), 2 * np.arange(order + 1) + 1)


def per_coefficient(per_band: np.ndarray) -> np.ndarray:
    """Expands values per band (order+1,) to values per coefficient (K,)."""
    per_band = np.asarray(per_band)
    return per_band[bands(len(per_band) - 1)]


def normalisation(l: int, m: int) -> float:
    """Returns the constant that makes Y_lm orthonormal: sqrt((2l+1)/(4 pi) (l-m)!/(l+m)!), times sqrt 2 for m > 0."""
    ratio = math.factorial(l - m) / math.factorial(l + m)
    return math.sqrt((2 - (m == 0)) * (2 * l + 1) / (4 * math.pi) * ratio)


def polynomials(x: Any, y: Any, z: Any, ones: Any, order: int) -> Iterator[tuple[int, Any]]:
    """Yields the index l*l + l + m and the values (...) of each Y_lm, for NumPy arrays and torch tensors alike.

    P_lm(z) / sin^m follows the three-term recurrence of the Legendre functions, and Re and Im of (x+iy)^m give the
    azimuth: polynomials in x, y, z, so that values and gradients are also exact at the poles.

    Args:
        x, y, z: components (...) of unit vectors.
        ones: (...) of the same type.
        order: the highest band.
    """
    azimuth = [(ones, 0 * ones)]
    for _ in range(order):
        cosine, sine = azimuth[-1]
        azimuth.append((x * cosine - y * sine, x * sine + y * cosine))
    sectoral = 1.0  # P_mm / sin^m = (2m-1)!!
    for m, (cosine, sine) in enumerate(azimuth):
        previous, legendre = 0 * ones, sectoral * ones  # P_lm / sin^m for l - 1 and l
        for l in range(m, order + 1):
            scale = normalisation(l, m)
            yield l * l + l + m, scale * legendre * cosine if m else scale * legendre
            if m:
                yield l * l + l - m, scale * legendre * sine
            previous, legendre = legendre, ((2 * l + 1) * z * legendre - (l + m) * previous) / (l - m + 1)
        sectoral *= 2 * m + 1


def basis(directions: np.ndarray, order: int = 2) -> np.ndarray:
    """Evaluates the spherical harmonics Y_lm.

    For order 2 these are 1, y, z, x, xy, yz, 3z^2-1, xz, x^2-y^2 times .282095, .488603 (3 times), 1.092548,
    1.092548, .315392, 1.092548, .546274.

    Args:
        directions: (...,3) unit vectors.
        order: the highest band.

    Returns:
        (...,K) float64.

    >>> basis(np.array([0.0, 0.0, 1.0]), 1).round(4).tolist()
    [0.2821, 0.0, 0.4886, 0.0]
    """
    directions = np.asarray(directions, np.float64)
    x, y, z = np.moveaxis(directions, -1, 0)
    values = np.empty((*x.shape, coefficient_count(order)))
    for index, value in polynomials(x, y, z, np.ones_like(x), order):
        values[..., index] = value
    return values


def cosine_factors(order: int) -> np.ndarray:
    """Returns the factors A_l (order+1,) of the clamped cosine: pi, 2 pi/3, pi/4, 0, -pi/24, ...

    Irradiance has the coefficients A_l L_lm (Ramamoorthi & Hanrahan 2001, equation 8).
    """
    factors = np.zeros(order + 1)
    factors[1:2] = 2 * math.pi / 3  # other odd bands have none
    for l in range(0, order + 1, 2):
        half = l // 2
        sign = 1 if half % 2 else -1
        factors[l] = 2 * math.pi * sign / ((l + 2) * (l - 1)) * math.comb(l, half) / 2**l
    return factors


def unoccluded(normals: np.ndarray, order: int = 2) -> np.ndarray:
    """Returns the transport T_lm(n) = A_l Y_lm(n) of unoccluded points, without 1/pi (method.md section 1).

    Args:
        normals: (...,3) unit vectors.
        order: the highest band.

    Returns:
        (...,K) float64.

    >>> unoccluded(np.array([0.0, 0.0, 1.0]), 1).round(4).tolist()
    [0.8862, 0.0, 1.0233, 0.0]
    """
    return basis(normals, order) * per_coefficient(cosine_factors(order))


def mean_direction(transport: np.ndarray) -> np.ndarray:
    """Returns where the linear band of transport points: the mean of the unoccluded directions, weighted by the cosine.

    That is the normal exactly where nothing is occluded, or what is occluded is symmetric about the normal; elsewhere
    it is bent toward the open side.

    Args:
        transport: (...,K) of order 1 or more.

    Returns:
        (...,3) unit vectors, of the transport's type; zero where the band is.

    >>> mean_direction(unoccluded(np.array([0.6, 0.0, 0.8]), 1)).round(6).tolist()
    [0.6, 0.0, 0.8]
    """
    linear = transport[..., [3, 1, 2]]  # Y_1-1, Y_10 and Y_11 are y, z and x times one factor
    length = np.linalg.norm(linear, axis=-1, keepdims=True)
    return np.divide(linear, length, out=np.zeros_like(linear), where=length > 0)


def irradiance(light: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Returns the irradiance E(n) = sum A_l L_lm Y_lm(n) of unoccluded surfaces.

    The truncated series can be slightly negative.

    Args:
        light: (...,K,C) radiance.
        normals: (N,3) or (3,) unit vectors.

    Returns:
        (...,N,C) or (...,C).
    """
    light = np.asarray(light, np.float64)
    return unoccluded(normals, order_of(light.shape[-2])) @ light


def sphere_quadrature(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns a quadrature rule on the sphere: Gauss-Legendre in z times equal steps of azimuth.

    Args:
        degree: largest degree of polynomials in x, y, z that are integrated exactly.

    Returns:
        Directions (N,3), and weights (N,) with the sum 4 pi.
    """
    z, z_weights = np.polynomial.legendre.leggauss(degree // 2 + 1)
    azimuth = 2 * np.pi * np.arange(degree + 1) / (degree + 1)
    sine = np.sqrt(1 - z * z)[:, None]  # of the angle from the pole
    directions = np.stack(np.broadcast_arrays(sine * np.cos(azimuth), sine * np.sin(azimuth), z[:, None]), -1)
    return directions.reshape(-1, 3), np.repeat(z_weights * 2 * np.pi / (degree + 1), degree + 1)


def sphere_spiral(count: int) -> np.ndarray:
    """Returns unit vectors (count,3) that are spread evenly over the sphere by a Fibonacci spiral."""
    index = np.arange(count)
    z = 1 - (2 * index + 1) / count
    azimuth = np.pi * (3 - np.sqrt(5)) * index  # a golden angle from one to the next
    sine = np.sqrt(1 - z * z)  # of the angle from the pole
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], -1)


def rotation_matrix(rotation: np.ndarray, order: int = 2) -> np.ndarray:
    """Returns the matrix that rotates coefficients.

    M_jk is the integral of Y_j(w) Y_k(R^T w), a polynomial of degree 2 * order, which the quadrature integrates
    exactly.

    Args:
        rotation: (3,3) rotation, or reflection, R of the light.
        order: the highest band.

    Returns:
        (K,K) float64; the rotated light has the coefficients M @ coefficients.
    """
    directions, weights = sphere_quadrature(2 * order)
    matrix = basis(directions, order).T @ (weights[:, None] * basis(directions @ rotation, order))
    band = bands(order)
    return np.where(band[:, None] == band, matrix, 0.0)  # bands do not mix: other entries are rounding errors


def rotation_about_y(angle: float) -> np.ndarray:
    """Returns the rotation (3,3) by `angle` radians about the vertical, from +z toward +x where positive."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rotate_y(light: np.ndarray, angle: float) -> np.ndarray:
    """Rotates a light (...,K,C) by `angle` radians about the vertical, from +z toward +x where positive."""
    light = np.asarray(light)
    return rotation_matrix(rotation_about_y(angle), order_of(light.shape[-2])) @ light
