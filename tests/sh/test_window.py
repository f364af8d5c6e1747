import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relight.sh import basis, deringed, irradiance, per_coefficient, rotation_matrix
from relight.sh.window import LEAST

INDEX = np.arange(20_000)
Z, AZIMUTH = 1 - (2 * INDEX + 1) / len(INDEX), 2.4 * INDEX
NORMALS = np.stack([np.sqrt(1 - Z * Z) * np.cos(AZIMUTH), np.sqrt(1 - Z * Z) * np.sin(AZIMUTH), Z], -1)
TOWARD = np.array([0.48, 0.6, 0.64])
channel = st.floats(0.01, 1)
colors = st.tuples(channel, channel, channel).map(np.array)


def lamp_in_a_room(color, room, degrees=5.0):
    """The light of a disc of that radius, whose irradiance on what faces it is `color`, and of even walls (`room`)."""
    c = np.cos(np.radians(degrees))
    light = np.outer(basis(TOWARD) * per_coefficient([1, (1 + c) / 2, c * (1 + c) / 2]), color)
    light[0] += np.asarray(room) * np.sqrt(4 * np.pi) / np.pi
    return light


def hue(color):
    return color / color.sum(-1, keepdims=True)


@settings(deadline=None, max_examples=25)
@given(colors)
def test_deringed_small_lamp_of_any_color(color):
    """Shaded sides have the lamp's hue exactly, no value is negative, and the peak loses a seventh at most."""
    light = lamp_in_a_room(color, 0)
    found, before = irradiance(deringed(light), NORMALS), irradiance(light, NORMALS)
    assert before.min() < -0.03 * color.max()
    assert found.min() > 0
    np.testing.assert_allclose(hue(found), np.broadcast_to(hue(color), found.shape), atol=1e-9)
    assert (found.max(0) > 0.86 * before.max(0)).all() and (found.max(0) > 0.91 * color).all()


@settings(deadline=None, max_examples=50)
@given(colors, st.floats(0.001, 2))
def test_deringed_small_lamp_in_a_room_keeps_the_hue_of_shade(color, level):
    """The side away from the lamp is never further on the other side of the white walls' hue than 0.31.

    The hue is the channels' parts of their sum. Clipping leaves up to 0.67: only the lamp's darkest channel is left.
    """
    light, shade = lamp_in_a_room(color, level * color.mean() / 4), NORMALS @ TOWARD < 0
    found = hue(irradiance(deringed(light), NORMALS[shade]))
    assert irradiance(deringed(light), NORMALS).min() > 0
    assert np.where(hue(color) > 1 / 3, 1 / 3 - found, found - 1 / 3).max() < 0.31


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_deringed_leaves_the_promised_least_irradiance(order):
    rng = np.random.default_rng(order)
    for _ in range(20):
        light = sum(np.outer(basis(d / np.linalg.norm(d), order), rng.random(3)) for d in rng.normal(size=(2, 3)))
        found, before = irradiance(deringed(light), NORMALS), irradiance(light, NORMALS)
        least = found.min(0) / found.mean(0)
        if (before.min(0) > LEAST * before.mean(0)).all():
            np.testing.assert_array_equal(deringed(light), light)
        else:
            assert least.min() == pytest.approx(LEAST, abs=0.011) and (least > LEAST - 0.011).all()
        np.testing.assert_allclose(deringed(deringed(light)), deringed(light), rtol=1e-12)
        np.testing.assert_allclose(deringed(3 * light), 3 * deringed(light), rtol=1e-12)


def test_deringed_light_turns_with_the_light():
    light = lamp_in_a_room([1, 0.7, 0.4], 0)
    turn = rotation_matrix(np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]))
    np.testing.assert_allclose(deringed(turn @ light), turn @ deringed(light), atol=0.005)


@pytest.mark.parametrize("color", [[1, 0, 0], [1, 0.3, 0], [0, 0, 0]])
def test_deringed_lamp_without_a_channel_is_that_of_the_others(color):
    white = deringed(lamp_in_a_room([1, 1, 1], 0))
    np.testing.assert_allclose(deringed(lamp_in_a_room(color, 0)), white * color, atol=1e-12)
