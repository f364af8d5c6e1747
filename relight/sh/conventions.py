"""Converts lights from and to the conventions of other programs.

relight          radiance coefficients, orthonormal, no Condon-Shortley, l*l + l + m, RGB; +z toward the camera, +y up
kanamori2018     the authors' released lights: 1, x, y, z, xy, yz, xz, 3z^2-1, x^2-y^2; columns blue, green, red
ramamoorthi2001  left-handed, z into the picture: L10, L2-1, L21 (odd in z) negated; their tables and prefilter.c
dpr              DPR's light files, z up and y away from the camera; often a single, grey channel
shtools          pyshtools' orthonormalised real coefficients without phase as a vector l*l + l + m; the frame of dpr
pifu             PIFu's env_sh.npy: the frame and the basis of relight
threejs          LightProbe.toJSON and SphericalHarmonics3.toArray: the frame and the basis of relight
unity            SphericalHarmonicsL2: irradiance / pi in 1, y, z, x, xy, yz, 3z^2-1, xz, x^2-y^2; z into the picture
unreal           FSHVectorRGB3: with Condon-Shortley phase; left-handed, x into the picture, y right, z up
irradiance       multiplied by A_l = pi, 2pi/3, pi/4: the coefficients of irradiance; order 2 at most
irradiance_pi    multiplied by A_l / pi = 1, 2/3, 1/4: the radiance of a white diffuser; order 2 at most
"""

from collections.abc import Callable

import numpy as np

from relight.core.errors import UserError
from relight.sh.harmonics import bands, coefficient_count, cosine_factors, order_of, per_coefficient, rotation_matrix

KANAMORI_ORDER = [0, 2, 3, 1, 4, 5, 7, 6, 8]  # indices in kanamori2018 of 1, y, z, x, xy, yz, 3z^2-1, xz, x^2-y^2
TO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # directions of relight to those of dpr: x, -z, y
TO_UNREAL = np.array([[0, 0, 1.0], [-1, 0, 0], [0, 1, 0]])  # -z, x, y, and half a turn, which is the phase (-1)^m
POLYNOMIALS = np.sqrt(np.array([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / (4 * np.pi))  # Y_lm over unity's
Converter = Callable[[np.ndarray], np.ndarray]
MAX_ORDER = 6  # files with more numbers are hardly lights
MAX_COEFFICIENT = 1e30  # pictures are float32, which overflows at 3e38


def as_table(numbers: object, name: str = "light") -> np.ndarray:
    """Reshapes the coefficients of a light to (K,3).

    Args:
        numbers: an array or nested lists: (K,3), (3,K), grey (K,) or (K,1), or flat (3 K,) RGB triples.
        name: for error messages.

    Returns:
        (K,3) float64.

    Raises:
        UserError: if the shape is none of these, or a number is not finite or beyond MAX_COEFFICIENT.
    """
    try:
        array = np.asarray(numbers).astype(np.float64, casting="same_kind").squeeze()  # not complex numbers
    except (TypeError, ValueError):
        raise UserError(f"{name} is not a table of real numbers") from None
    sizes = {coefficient_count(order) for order in range(MAX_ORDER + 1)}
    if array.ndim == 1 and array.size in sizes:
        array = np.repeat(array[:, None], 3, 1)
    elif array.ndim == 1 and array.size % 3 == 0 and array.size // 3 in sizes:
        array = array.reshape(-1, 3)
    elif array.ndim == 2 and array.shape[0] == 3 and array.shape[1] in sizes:
        array = array.T
    if array.ndim != 2 or array.shape[1] != 3 or array.shape[0] not in sizes:
        raise UserError(f"{name} has the shape {array.shape}; a light has 9 x 3 coefficients, or 4, 16, 25 ... x 3")
    require_bounded(array, name)
    return array


def require_bounded(coefficients: np.ndarray, name: str) -> None:
    """Raises UserError, with the light's `name`, unless its coefficients are finite, and at most MAX_COEFFICIENT."""
    if not (largest := np.abs(coefficients).max()) <= MAX_COEFFICIENT:
        known = f"finite numbers, at most {MAX_COEFFICIENT:.0e}"
        raise UserError(f"{name} has the coefficient {largest:.0e}: coefficients must be {known}")


def from_kanamori(light: np.ndarray) -> np.ndarray:
    """Converts a light (9,3) from kanamori2018 to relight."""
    require_order_2(light, "kanamori2018")
    return light[KANAMORI_ORDER][:, ::-1]


def to_kanamori(light: np.ndarray) -> np.ndarray:
    """Converts a light (9,3) from relight to kanamori2018."""
    require_order_2(light, "kanamori2018")
    return light[np.argsort(KANAMORI_ORDER)][:, ::-1]


def mirror_z(light: np.ndarray) -> np.ndarray:
    """Mirrors a light (K,3) in z by negating the coefficients with odd l + m, whose Y_lm are odd in z."""
    l = bands(order_of(len(light)))
    return light * np.where((np.arange(len(light)) - l * l) % 2, -1.0, 1.0)[:, None]


def framed(axes: np.ndarray) -> tuple[Converter, Converter]:
    """Returns the functions to relight and back for a frame whose directions are `axes` (3,3) times relight's."""

    def turned(rotation: np.ndarray) -> Converter:
        return lambda light: rotation_matrix(rotation, order_of(len(light))) @ light

    return turned(axes.T), turned(axes)


def unity_factors(light: np.ndarray) -> np.ndarray:
    """Returns unity's coefficients of a light (9,3) over those of relight in unity's frame: (9,1)."""
    require_order_2(light, "unity")
    return irradiance_factors(light) / np.pi * POLYNOMIALS[:, None]


def irradiance_factors(light: np.ndarray) -> np.ndarray:
    """Returns A_l (K,1) for the coefficients of a light (K,3); raises UserError above order 2, where some are zero."""
    if (order := order_of(len(light))) > 2:
        raise UserError(f"irradiance has no bands 3, 5, ...: it expresses lights of order 0 to 2, not of order {order}")
    return per_coefficient(cosine_factors(order))[:, None]


def require_order_2(light: np.ndarray, name: str) -> None:
    """Raises UserError unless the light of the convention `name` has nine coefficients."""
    if len(light) != 9:
        raise UserError(f"{name}: the light has {len(light)} coefficients; this convention needs 9")


# Functions to relight's convention and back, by the name of the convention.
CONVENTIONS: dict[str, tuple[Converter, Converter]] = {
    "relight": (np.copy, np.copy),
    "kanamori2018": (from_kanamori, to_kanamori),
    "ramamoorthi2001": (mirror_z, mirror_z),
    "dpr": framed(TO_Z_UP),
    "shtools": framed(TO_Z_UP),
    "pifu": (np.copy, np.copy),
    "threejs": (np.copy, np.copy),
    "unity": (
        lambda light: mirror_z(light / unity_factors(light)),
        lambda light: mirror_z(light) * unity_factors(light),
    ),
    "unreal": framed(TO_UNREAL),
    "irradiance": (lambda light: light / irradiance_factors(light), lambda light: light * irradiance_factors(light)),
    "irradiance_pi": (
        lambda light: light / irradiance_factors(light) * np.pi,
        lambda light: light * irradiance_factors(light) / np.pi,
    ),
}


def to_relight(array: np.ndarray, name: str) -> np.ndarray:
    """Converts a light of the convention `name`, in any shape that `as_table` takes, to relight's (K,3) float64.

    Raises:
        UserError: if there is no such convention, or if it cannot express the light.

    >>> to_relight(np.eye(9, 3), "ramamoorthi2001")[2].tolist()  # odd in z
    [-0.0, -0.0, -1.0]
    """
    return converters(name)[0](as_table(array))


def from_relight(array: np.ndarray, name: str) -> np.ndarray:
    """Converts a light of relight to (K,3) in the convention `name`; the inverse of `to_relight`.

    Raises:
        UserError: if there is no such convention, or if it cannot express the light.
    """
    return converters(name)[1](as_table(array))


def converters(name: str) -> tuple[Converter, Converter]:
    """Returns the functions from the convention `name` to relight and back; raises UserError if it is unknown."""
    if name not in CONVENTIONS:
        raise UserError(f"convention {name!r}: must be one of {', '.join(CONVENTIONS)}")
    return CONVENTIONS[name]
