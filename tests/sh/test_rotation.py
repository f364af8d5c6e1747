import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relight.sh import basis, coefficient_count, irradiance, rotation_about_y, rotation_matrix


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_rotated_light_is_that_of_the_unrotated_direction_and_rotation_about_y_is_scipys(order):
    np.testing.assert_allclose(rotation_about_y(0.7), Rotation.from_rotvec([0, 0.7, 0]).as_matrix(), atol=1e-15)
    rng = np.random.default_rng(order)
    d = rng.normal(size=(100, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    light = rng.normal(size=(coefficient_count(order), 3))
    for rotation in Rotation.random(5, rng=order).as_matrix():
        turned = rotation_matrix(rotation, order) @ light
        np.testing.assert_allclose(basis(d, order) @ turned, basis(d @ rotation, order) @ light, atol=1e-12)


def test_irradiance_of_a_distant_lamp_and_of_a_constant_sky():
    toward = np.array([0.6, 0.0, 0.8])
    lamp = basis(toward)[:, None] * np.ones(3)
    c = np.array([1.0, 0.5, 0.0, -8 / 15, -1.0])
    normals = c[:, None] * toward + np.sqrt(1 - c**2)[:, None] * [0, 1, 0]
    expected = (1 + 2 * c + 5 / 8 * (3 * c * c - 1)) / 4
    np.testing.assert_allclose(irradiance(lamp, normals), np.repeat(expected[:, None], 3, 1), atol=1e-14)
    sky = np.eye(9, 1) * np.sqrt(4 * np.pi) * [1, 2, 3]
    np.testing.assert_allclose(irradiance(sky, [0, 0, 1]), [np.pi, 2 * np.pi, 3 * np.pi], rtol=1e-14)
