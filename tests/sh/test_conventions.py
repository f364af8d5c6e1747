"""Each convention is held against its own formula: the irradiance from six directions, written out as its users do."""

import numpy as np
import pytest

from relight.core.errors import UserError
from relight.sh import CONVENTIONS, basis, from_relight, irradiance, to_relight
from relight.sh.conventions import as_table

SIX = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
DIAGONAL = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1], [1, -1, 0], [0, 1, -1], [-1, 0, 1]]) / np.sqrt(2)
NORMALS = np.concatenate([SIX, DIAGONAL])  # the six tell all of bands 0 and 1; the diagonals the rest of band 2
A = np.pi, 2 * np.pi / 3, np.pi / 4


def polynomials(x, y, z):
    """1, x, y, z, xy, yz, xz, 3z^2-1, x^2-y^2 with their constants and A_l, by name."""
    return {
        "1": A[0] * 0.28209479 * np.ones_like(x),
        "x": A[1] * 0.48860251 * x, "y": A[1] * 0.48860251 * y, "z": A[1] * 0.48860251 * z,
        "xy": A[2] * 1.09254843 * x * y, "yz": A[2] * 1.09254843 * y * z, "xz": A[2] * 1.09254843 * x * z,
        "3z2-1": A[2] * 0.31539157 * (3 * z * z - 1), "x2-y2": A[2] * 0.54627422 * (x * x - y * y),
    }  # fmt: skip


OURS = ["1", "y", "z", "x", "xy", "yz", "3z2-1", "xz", "x2-y2"]


def shade(light, names, frame):
    """Irradiance (N, C) by a convention's own order of terms, in its own frame: what `frame` makes of a normal."""
    terms = polynomials(*frame(*NORMALS.T))
    return sum(np.outer(terms[name], row) for name, row in zip(names, light))


def relight(light):
    return shade(light, OURS, lambda x, y, z: (x, y, z))


def kanamori(light):  # columns B, G, R
    return shade(light[:, ::-1], "1 x y z xy yz xz 3z2-1 x2-y2".split(), lambda x, y, z: (x, y, z))


def dpr(light):
    return shade(light, OURS, lambda x, y, z: (x, -z, y))  # z up, the camera on the side of -y


def ramamoorthi(light):
    """Equation 13 of the paper as printed, with c1..c5, in its left-handed frame."""
    c1, c2, c3, c4, c5 = 0.429043, 0.511664, 0.743125, 0.886227, 0.247708
    x, y, z = (a[:, None] for a in (NORMALS * [1, 1, -1]).T)
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = light
    return (
        c1 * l22 * (x * x - y * y) + c3 * l20 * z * z + c4 * l00 - c5 * l20
        + 2 * c1 * (l2m2 * x * y + l21 * x * z + l2m1 * y * z) + 2 * c2 * (l11 * x + l1m1 * y + l10 * z)
    )  # fmt: skip


def threejs(light):
    """SphericalHarmonics3.getIrradianceAt."""
    x, y, z = (a[:, None] for a in NORMALS.T)
    c = light
    return (
        c[0] * 0.886227 + c[1] * 2 * 0.511664 * y + c[2] * 2 * 0.511664 * z + c[3] * 2 * 0.511664 * x
        + c[4] * 2 * 0.429043 * x * y + c[5] * 2 * 0.429043 * y * z + c[6] * (0.743125 * z * z - 0.247708)
        + c[7] * 2 * 0.429043 * x * z + c[8] * 0.429043 * (x * x - y * y)
    )  # fmt: skip


def unity(light):
    """ShadeSH9 of Unity's shaders, whose constants are made of SphericalHarmonicsL2 so; it gives irradiance / pi."""
    x, y, z = (a[:, None] for a in (NORMALS * [1, 1, -1]).T)  # z away from the camera
    linear = light[3] * x + light[1] * y + light[2] * z + (light[0] - light[6])
    quadratic = light[4] * x * y + light[5] * y * z + 3 * light[6] * z * z + light[7] * x * z
    return np.pi * (linear + quadratic + light[8] * (x * x - y * y))


def unreal(light):
    """The sky light of Unreal Engine: constants of an FSHVectorRGB3, and the sum in its shaders: irradiance / pi."""
    x, y, z = (a[:, None] for a in (-NORMALS[:, 2], NORMALS[:, 0], NORMALS[:, 1]))  # ahead, right, up
    root = np.sqrt(np.pi)
    c0, c1, c2, c3 = 1 / (2 * root), np.sqrt(3) / (3 * root), np.sqrt(15) / (8 * root), np.sqrt(5) / (16 * root)
    linear = c0 * light[0] - c3 * light[6] - c1 * light[3] * x - c1 * light[1] * y + c1 * light[2] * z
    quadratic = c2 * (light[4] * x * y - light[5] * y * z - light[7] * x * z) + 3 * c3 * light[6] * z * z
    return np.pi * (linear + quadratic + c2 / 2 * light[8] * (x * x - y * y))


BANDS = np.repeat(A, [1, 3, 5])[:, None]  # which coefficients of irradiance hold already
THEIRS = {
    "relight": relight, "pifu": relight, "kanamori2018": kanamori, "ramamoorthi2001": ramamoorthi, "dpr": dpr,
    "shtools": dpr, "threejs": threejs, "unity": unity, "unreal": unreal,
    "irradiance": lambda light: relight(light / BANDS), "irradiance_pi": lambda light: relight(light * np.pi / BANDS),
}  # fmt: skip


@pytest.mark.parametrize("name", CONVENTIONS)
def test_irradiance_by_their_formula_is_irradiance_by_ours_and_round_trips_are_exact(name):
    light = np.random.default_rng(0).normal(size=(9, 3))
    np.testing.assert_allclose(THEIRS[name](light), irradiance(to_relight(light, name), NORMALS), atol=2e-5)
    np.testing.assert_allclose(to_relight(from_relight(light, name), name), light, atol=1e-14)
    np.testing.assert_allclose(from_relight(to_relight(light, name), name), light, atol=1e-14)


@pytest.mark.parametrize("name", ["ramamoorthi2001", "dpr"])
def test_frames_hold_at_higher_orders(name):
    light = np.random.default_rng(2).normal(size=(25, 3))
    frame = {"ramamoorthi2001": NORMALS * [1, 1, -1], "dpr": NORMALS[:, [0, 2, 1]] * [1, -1, 1]}[name]
    np.testing.assert_allclose(basis(NORMALS, 4) @ to_relight(light, name), basis(frame, 4) @ light, atol=1e-13)


def test_stored_shapes_become_one():
    light = np.arange(27.0).reshape(9, 3)
    for stored in (light, light.T, light.ravel(), light.ravel().tolist(), light[None]):
        np.testing.assert_array_equal(as_table(stored), light)
    np.testing.assert_array_equal(as_table(np.arange(9.0)), np.repeat(np.arange(9.0)[:, None], 3, 1))
    for wrong in (np.zeros((8, 3)), np.zeros((9, 4)), np.zeros(10), "light", [[1, 2], [3]], light * 1j):
        with pytest.raises(UserError):
            as_table(wrong)
    with pytest.raises(UserError, match="finite"):
        as_table(np.full((9, 3), np.nan))


def test_lights_that_a_convention_cannot_hold_are_refused():
    with pytest.raises(UserError, match="one of"):
        to_relight(np.zeros((9, 3)), "opengl")
    with pytest.raises(UserError, match="kanamori2018"):
        to_relight(np.zeros((16, 3)), "kanamori2018")
    with pytest.raises(UserError, match="order 3"):
        from_relight(np.zeros((16, 3)), "irradiance")
