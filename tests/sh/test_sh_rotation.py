import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relight.sh import basis, coefficient_count, irradiance, rotate_y, rotation_about_y, rotation_matrix


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_rotated_light_is_the_light_looked_up_at_the_unrotated_direction(order):
    rng = np.random.default_rng(order)
    d = rng.normal(size=(100, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    light = rng.normal(size=(coefficient_count(order), 3))
    for rotation in Rotation.random(5, rng=order).as_matrix():
        turned = rotation_matrix(rotation, order) @ light
        np.testing.assert_allclose(basis(d, order) @ turned, basis(d @ rotation, order) @ light, atol=1e-12)


def test_rotate_y_is_the_closed_form():
    """method.md section 1, written out."""
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = np.random.default_rng(0).normal(size=9)
    light = np.array([l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22])[:, None]
    for degrees in (10, 77, 180, -35):
        a = np.radians(degrees)
        c, s, r = np.cos(a), np.sin(a), np.sqrt(3)
        p, q = -l20 / 2 - r / 2 * l22, -r / 2 * l20 + l22 / 2
        q2, s2 = np.cos(2 * a) * q + np.sin(2 * a) * l21, -np.sin(2 * a) * q + np.cos(2 * a) * l21
        first = [l00, l1m1, c * l10 - s * l11, c * l11 + s * l10]
        second = [c * l2m2 + s * l2m1, -s * l2m2 + c * l2m1, -p / 2 - r / 2 * q2, s2, -r / 2 * p + q2 / 2]
        np.testing.assert_allclose(rotate_y(light, a)[:, 0], first + second, atol=1e-14)


def test_rotation_about_y_is_scipys():
    expected = Rotation.from_rotvec([0, 0.7, 0]).as_matrix()
    np.testing.assert_allclose(rotation_about_y(0.7), expected, atol=1e-15)
    np.testing.assert_allclose(rotation_about_y(np.pi / 2) @ [0, 0, 1], [1, 0, 0], atol=1e-15)


def test_irradiance_of_a_distant_lamp_and_of_a_constant_sky():
    toward = np.array([0.6, 0.0, 0.8])
    lamp = basis(toward)[:, None] * np.ones(3)
    c = np.array([1.0, 0.5, 0.0, -8 / 15, -1.0])
    side = np.array([0.0, 1.0, 0.0])
    normals = c[:, None] * toward + np.sqrt(1 - c**2)[:, None] * side
    expected = (1 + 2 * c + 5 / 8 * (3 * c * c - 1)) / 4
    np.testing.assert_allclose(irradiance(lamp, normals), np.repeat(expected[:, None], 3, 1), atol=1e-14)

    sky = np.zeros((9, 3))
    sky[0] = np.sqrt(4 * np.pi) * np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(irradiance(sky, [0, 0, 1]), np.pi * np.array([1.0, 2.0, 3.0]), rtol=1e-14)
