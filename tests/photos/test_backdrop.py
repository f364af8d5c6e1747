import numpy as np
import pytest
from scipy.ndimage import zoom

from relight.panoramas import Panorama, project
from relight.panoramas.lookup import lookup
from relight.photos.backdrop import camera_view
from relight.sh import basis, sphere_quadrature

SHAPES = {
    "latlong": (64, 128), "angular": (128, 128), "ball": (256, 256), "cross": (128, 96), "strip": (32, 192),
    "strip-gl": (192, 32),
}  # fmt: skip


def smooth(shape, seed=0):
    """A panorama of a few broad lamps, smooth enough for bilinear values, drawn in the layout by looking it up."""
    pixels = np.random.default_rng(seed).random((4, 4, 3))
    return zoom(pixels, (shape[0] / 4, shape[1] / 4, 1), order=1).astype(np.float32)


@pytest.mark.parametrize("layout", SHAPES)
@pytest.mark.parametrize("orientation", [{"yaw": 35.0, "flip": True}, {"yaw": -495.0, "front": "+z"}])
def test_lookup_is_the_inverse_of_projection(layout, orientation):
    panorama = Panorama(smooth(SHAPES[layout]), layout=layout, **orientation)
    directions, weights = sphere_quadrature(120)
    light, expected = basis(directions, 2).T @ (weights[:, None] * lookup(panorama, directions)), project(panorama, 2)
    assert np.abs(light - expected).max() < 0.02 * np.abs(expected).max()


@pytest.mark.parametrize("layout, pole", [("angular", 1.0), ("ball", -1.0)])
def test_the_rim_of_a_round_panorama_is_one_direction(layout, pole):
    pixels = (np.hypot(*(np.indices((65, 65, 3))[:2] - 32)) > 31).astype(np.float32)
    seen = lookup(Panorama(pixels, layout), np.array([[0, 0, pole], [1e-14, 0, pole], [0, -1e-9, pole], [0, 0, -pole]]))
    np.testing.assert_allclose(seen[:, 0], [1, 1, 1, 0], atol=1e-6)


def test_exr_panoramas_look_the_other_way():
    pixels = smooth((33, 65))
    panorama = Panorama(pixels, corners=True, front="+z")
    assert np.allclose(lookup(panorama, np.array([0.0, 0, 1])), pixels[16, 32], atol=1e-6)
    assert np.allclose(lookup(panorama, np.array([0.0, 1, 0])), pixels[0, 32], atol=1e-2)


def test_the_camera_sees_ahead_and_turns_with_the_light():
    pixels = np.zeros((64, 128, 3), np.float32)
    pixels[30:34, 62:66] = 50  # a lamp in the middle: straight ahead, behind the figure
    panorama = Panorama(pixels)
    view = camera_view(panorama, (60, 90))[..., 0]
    assert np.unravel_index(view.argmax(), view.shape)[0] in (29, 30) and abs(view.argmax() % 90 - 44.5) <= 1
    # turned by a > 0 (+z toward +x), what is on -z moves toward -x: to the left
    x = camera_view(panorama, (60, 90), np.radians(15))[..., 0].argmax() % 90
    assert abs((x + 0.5 - 45) - -np.tan(np.radians(15)) * 45 / np.tan(np.radians(25))) < 1.5
    assert camera_view(panorama, (60, 90), np.radians(180)).max() < 0.1
    blurred = camera_view(panorama, (60, 90), 0, 5.0)[..., 0]
    assert blurred.max() < 0.6 * view.max() and abs(blurred.sum() / view.sum() - 1) < 0.1
