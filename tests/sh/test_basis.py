import numpy as np
import pytest
from scipy.special import sph_harm_y

from relight.core.errors import UserError
from relight.sh import basis, cosine_factors, mean_direction, order_of, per_coefficient, rotation_matrix


def directions(n, seed=0):
    d = np.random.default_rng(seed).normal(size=(n, 3))
    d = np.concatenate([d, np.eye(3), -np.eye(3)])
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def test_basis_is_scipys_without_the_phase():
    d = directions(300)
    theta, phi = np.arccos(np.clip(d[:, 2], -1, 1)), np.arctan2(d[:, 1], d[:, 0])
    ours = basis(d, 6)
    for l in range(7):
        for m in range(-l, l + 1):
            y = sph_harm_y(l, abs(m), theta, phi)
            truth = (y.real if m >= 0 else y.imag) * (1 if m == 0 else np.sqrt(2) * (-1) ** m)
            np.testing.assert_allclose(ours[:, l * l + l + m], truth, atol=1e-12)


def test_the_largest_order_adds_up_and_a_larger_one_is_refused():
    """The squares of the 2 l + 1 harmonics of a band add up to (2 l + 1) / 4 pi in every direction."""
    total = (basis(directions(20), 85)[:, 85**2 :] ** 2).sum(1)
    np.testing.assert_allclose(total, (2 * 85 + 1) / (4 * np.pi), rtol=1e-12)
    with pytest.raises(UserError, match="order 86: it must be at most 85"):
        basis(directions(1), 86)


def test_cosine_factors_project_the_clamped_cosine():
    # Zonal coefficients of max(cos, 0) are A_l sqrt((2l+1)/4pi); the hemisphere alone is polynomial, so exact.
    x, w = np.polynomial.legendre.leggauss(20)
    x, w = (x + 1) / 2, w / 2
    for l, factor in enumerate(cosine_factors(6)):
        assert abs(2 * np.pi * np.sum(w * x * np.polynomial.legendre.Legendre.basis(l)(x)) - factor) < 1e-13
    np.testing.assert_allclose(cosine_factors(4), [np.pi, 2 * np.pi / 3, np.pi / 4, 0, -np.pi / 24])


def test_per_coefficient_and_order_of():
    assert per_coefficient([1, 2, 3]).tolist() == [1, 2, 2, 2, 3, 3, 3, 3, 3]
    assert [order_of(k) for k in (1, 4, 9, 16, 49)] == [0, 1, 2, 3, 6]
    for wrong in (0, 8, 27):
        with pytest.raises(UserError, match="full set"):
            order_of(wrong)


def transport_of(visible, count=200):
    """Transport (9,) at the normal (0,0,1) by a rule for the hemisphere; visible: of directions (N,3), bool."""
    z, weights = np.polynomial.legendre.leggauss(count)
    z, weights = (z + 1) / 2, weights / 2
    azimuth = 2 * np.pi * (np.arange(2 * count) + 0.5) / (2 * count)
    side = np.sqrt(1 - z * z)[:, None]
    d = np.stack(np.broadcast_arrays(side * np.cos(azimuth), side * np.sin(azimuth), z[:, None]), -1).reshape(-1, 3)
    weights = np.repeat(weights * np.pi / count, 2 * count)
    return (weights * d[:, 2] * visible(d)) @ basis(d)


def test_mean_direction_is_the_normal_where_occlusion_is_symmetric():
    normals = directions(50, seed=1)
    for visible in (lambda d: np.ones(len(d)), lambda d: d[:, 2] > 0.7, lambda d: np.abs(d[:, 0]) < d[:, 2]):
        transport = transport_of(visible)
        np.testing.assert_allclose(mean_direction(transport), [0, 0, 1], atol=1e-6)
        for normal in normals:
            side = np.linalg.qr(np.stack([normal, *np.eye(3)[:2]], 1))[0]
            turn = np.stack([side[:, 1], side[:, 2], normal], 1)  # or a reflection, which the coefficients follow, too
            np.testing.assert_allclose(mean_direction(rotation_matrix(turn) @ transport), normal, atol=1e-6)


def test_mean_direction_bends_away_from_a_wall():
    """A wall at x = 0 beside the point: the integrals of x cos and z cos over the half are 2/3 and pi/3."""
    bent = mean_direction(np.stack([transport_of(lambda d: d[:, 0] > 0), np.zeros(9)]))
    np.testing.assert_allclose(np.degrees(np.arctan2(*bent[0, [0, 2]])), np.degrees(np.arctan(2 / np.pi)), atol=1e-3)
    assert abs(bent[0, 1]) < 1e-9 and not bent[1].any()
