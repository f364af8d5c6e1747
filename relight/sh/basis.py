"""Real spherical harmonics: orthonormal, without the Condon-Shortley phase, index l*l + l + m, pole along +z."""

import math
from functools import cache

import numpy as np

from relight.files import UserError


def count(order: int) -> int:
    """The number of coefficients up to and including band `order`: (order + 1)^2."""
    return (order + 1) ** 2


def order_of(coefficients: int) -> int:
    """The order that has so many coefficients; UserError when no order has."""
    order = math.isqrt(max(coefficients, 1)) - 1
    if count(order) != coefficients:
        raise UserError(f"{coefficients} spherical-harmonic coefficients: a full set has 1, 4, 9, 16, 25 ... of them")
    return order


def bands(order: int) -> np.ndarray:
    """The band l of each coefficient, (K,) int: 0, 1, 1, 1, 2, ..."""
    return np.repeat(np.arange(order + 1), 2 * np.arange(order + 1) + 1)


def per_coefficient(per_band: np.ndarray) -> np.ndarray:
    """Spreads one value per band, (order + 1,), over the coefficients, (K,)."""
    per_band = np.asarray(per_band)
    return per_band[bands(len(per_band) - 1)]


@cache
def normalisation(l: int, m: int) -> float:
    """sqrt((2l+1)/(4 pi) (l-m)!/(l+m)!), times sqrt 2 for m > 0: makes Y_lm of unit length on the sphere."""
    ratio = math.factorial(l - m) / math.factorial(l + m)
    return math.sqrt((2 - (m == 0)) * (2 * l + 1) / (4 * math.pi) * ratio)


def basis(directions: np.ndarray, order: int = 2) -> np.ndarray:
    """Y_lm at unit `directions` (..., 3), as (..., K) float64.

    For order 2 these are 1, y, z, x, xy, yz, 3z^2-1, xz, x^2-y^2 times .282095, .488603 (3 times), 1.092548,
    1.092548, .315392, 1.092548, .546274. Polynomials in x, y, z, hence exact at the poles too: P_lm(z) / sin^m
    follows the usual three-term recurrence and Re, Im (x+iy)^m carry the azimuth.
    """
    directions = np.asarray(directions, np.float64)
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    values = np.empty((*x.shape, count(order)))
    cosine, sine = np.ones_like(x), np.zeros_like(x)
    sectoral = 1.0  # P_mm / sin^m = (2m-1)!!
    for m in range(order + 1):
        before, legendre = np.zeros_like(z), np.full_like(z, sectoral)
        for l in range(m, order + 1):
            scaled = normalisation(l, m) * legendre
            values[..., l * l + l + m] = scaled * cosine
            if m:
                values[..., l * l + l - m] = scaled * sine
            before, legendre = legendre, ((2 * l + 1) * z * legendre - (l + m) * before) / (l - m + 1)
        cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        sectoral *= 2 * m + 1
    return values


def cosine_factors(order: int) -> np.ndarray:
    """A_l of the clamped cosine, (order + 1,): pi, 2pi/3, pi/4, 0, -pi/24, ... (Ramamoorthi & Hanrahan 2001, eq. 8)."""
    factors = np.zeros(order + 1)
    for l in range(order + 1):
        if l == 1:
            factors[l] = 2 * math.pi / 3
        elif l % 2 == 0:
            half = l // 2
            sign = 1 if half % 2 else -1
            factors[l] = 2 * math.pi * sign / ((l + 2) * (l - 1)) * math.comb(l, half) / 2**l
    return factors
