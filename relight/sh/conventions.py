"""Lights in the conventions of other programs: converted at the border, by name, both ways.

relight          radiance coefficients, orthonormal, no Condon-Shortley, l*l + l + m, RGB; +z toward the camera, +y up
kanamori2018     the authors' released lights: 1, x, y, z, xy, yz, xz, 3z^2-1, x^2-y^2; columns blue, green, red
ramamoorthi2001  left-handed, z into the picture: L10, L2-1, L21 (odd in z) negated; the printed tables, prefilter.c
dpr              DPR's light files, z up and y away from the camera; often a single channel, which is then grey
shtools          pyshtools' orthonormalised real coefficients without phase as a vector l*l + l + m; the frame of dpr
pifu             PIFu's env_sh.npy: the frame and the basis of relight
threejs          LightProbe.toJSON and SphericalHarmonics3.toArray: the frame and the basis of relight
irradiance       multiplied by A_l = pi, 2pi/3, pi/4: the coefficients of irradiance; order 2 at most
irradiance_pi    multiplied by A_l / pi = 1, 2/3, 1/4: the radiance of a white diffuser; order 2 at most
"""

from collections.abc import Callable

import numpy as np

from relight.files import UserError
from relight.sh.basis import bands, cosine_factors, count, order_of, per_coefficient
from relight.sh.rotation import rotation_matrix

KANAMORI_ORDER = [0, 2, 3, 1, 4, 5, 7, 6, 8]  # where our 1, y, z, x, xy, yz, 3z^2-1, xz, x^2-y^2 stand in theirs
TO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # our directions to dpr's: x, -z, y
LARGEST = 6  # order; beyond it a file is more likely something else


def as_table(array: np.ndarray, name: str = "light") -> np.ndarray:
    """Coefficients as (K, 3) float64, from (K, 3), (3, K), a grey (K,) or (K, 1), or a flat row of 3 K, RGB RGB ...

    UserError when the shape is none of these or a number is not finite.
    """
    try:
        array = np.asarray(array, np.float64).squeeze()
    except (TypeError, ValueError):
        raise UserError(f"{name}: not a table of numbers") from None
    sizes = {count(order) for order in range(LARGEST + 1)}
    if array.ndim == 1 and array.size in sizes:
        array = np.repeat(array[:, None], 3, 1)
    elif array.ndim == 1 and array.size % 3 == 0 and array.size // 3 in sizes:
        array = array.reshape(-1, 3)
    elif array.ndim == 2 and array.shape[0] == 3 and array.shape[1] in sizes:
        array = array.T
    if array.ndim != 2 or array.shape[1] != 3 or array.shape[0] not in sizes:
        raise UserError(
            f"{name}: a table of shape {array.shape}; a light has 9 x 3 numbers (4, 16, 25 ... for other orders)"
        )
    if not np.isfinite(array).all():
        raise UserError(f"{name}: has numbers that are not finite")
    return array


def reorder(light: np.ndarray) -> np.ndarray:
    only_order_2(light, "kanamori2018")
    return light[KANAMORI_ORDER][:, ::-1]


def reorder_back(light: np.ndarray) -> np.ndarray:
    only_order_2(light, "kanamori2018")
    theirs = np.empty_like(light)
    theirs[KANAMORI_ORDER] = light[:, ::-1]
    return theirs


def mirror_z(light: np.ndarray) -> np.ndarray:
    """Its own inverse: Y_lm is odd in z where l + m is odd."""
    k = np.arange(len(light))
    l = bands(order_of(len(light)))
    return light * np.where((k - l * l) % 2, -1.0, 1.0)[:, None]


def from_z_up(light: np.ndarray) -> np.ndarray:
    return rotation_matrix(TO_Z_UP.T, order_of(len(light))) @ light


def to_z_up(light: np.ndarray) -> np.ndarray:
    return rotation_matrix(TO_Z_UP, order_of(len(light))) @ light


def factors(light: np.ndarray) -> np.ndarray:
    order = order_of(len(light))
    if order > 2:
        raise UserError(f"irradiance has nothing of bands 3, 5, ...: a light of order {order} cannot be told from it")
    return per_coefficient(cosine_factors(order))[:, None]


def only_order_2(light: np.ndarray, name: str) -> None:
    if len(light) != 9:
        raise UserError(f"{name}: {len(light)} coefficients; its lights have 9")


def same(light: np.ndarray) -> np.ndarray:
    return light


# Name: (theirs to ours, ours to theirs)
CONVENTIONS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]] = {
    "relight": (same, same),
    "kanamori2018": (reorder, reorder_back),
    "ramamoorthi2001": (mirror_z, mirror_z),
    "dpr": (from_z_up, to_z_up),
    "shtools": (from_z_up, to_z_up),
    "pifu": (same, same),
    "threejs": (same, same),
    "irradiance": (lambda light: light / factors(light), lambda light: light * factors(light)),
    "irradiance_pi": (lambda light: light / factors(light) * np.pi, lambda light: light * factors(light) / np.pi),
}


def to_relight(array: np.ndarray, name: str) -> np.ndarray:
    """A light of the convention `name`, in any of the shapes of `as_table`, as relight's (K, 3) float64."""
    return converters(name)[0](as_table(array))


def from_relight(array: np.ndarray, name: str) -> np.ndarray:
    """relight's (K, 3) as a light (K, 3) of the convention `name`; the exact inverse of `to_relight`."""
    return converters(name)[1](as_table(array))


def converters(name: str):
    if name not in CONVENTIONS:
        raise UserError(f"convention {name!r}: one of {', '.join(CONVENTIONS)}")
    return CONVENTIONS[name]
