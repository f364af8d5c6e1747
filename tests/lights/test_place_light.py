import json

import numpy as np
import pytest

from relight.core.srgb import encode, to_bytes
from relight.lights.light import direction
from relight.lights.place import IRRADIANCE, STATISTICS, features, place_light, thumbnail
from relight.lights.statistics import moment_eigenvalue
from relight.panoramas import luminance

MIRROR = np.array([1, 1, 1, -1, -1, 1, 1, -1, 1.0])[:, None]


def codes(linear):
    return to_bytes(encode(np.asarray(linear, float)))


def street(seed, size=(36, 48)):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]] / np.array(size)[:, None, None]
    light = np.exp(rng.normal(0, 1.5) * x + rng.normal(-1, 1) * y + rng.normal(0, 0.3, size)) * rng.uniform(0.05, 1)
    return codes(light[..., None] * np.exp(rng.normal(0, 0.4, 3)))


def test_place_light_of_the_mirror_image_is_mirrored():
    for picture in map(street, range(5)):
        np.testing.assert_allclose(place_light(picture[:, ::-1]), place_light(picture) * MIRROR, atol=2e-3)


def test_place_light_comes_from_the_brighter_side():
    left_to_right = np.tile(np.linspace(0.02, 0.8, 48)[None, :, None], (36, 1, 3))
    sides = [luminance(place_light(codes(picture)))[3] for picture in (left_to_right, left_to_right[:, ::-1])]
    assert sides[0] > 0.05 > -0.05 > sides[1]


def test_place_light_takes_on_the_root_of_the_color():
    toward = direction(30, 40, "lamp")
    grey, orange = (place_light(codes(np.full((36, 48, 3), color)), toward)[0] for color in (0.25, (0.5, 0.3, 0.1)))
    np.testing.assert_allclose(grey / grey[1], 1, rtol=1e-9)
    np.testing.assert_allclose(orange / orange[1], np.sqrt([0.5 / 0.3, 1, 0.1 / 0.3]), rtol=0.01)


@pytest.mark.parametrize("toward", [None, np.array([1.0, 0.0, 0.0])])
def test_place_light_has_the_exposure_of_the_picture(toward):
    level = json.loads(STATISTICS.read_text())["level"] * luminance(thumbnail(street(1))).mean()
    assert np.linalg.norm(place_light(street(1), toward) * IRRADIANCE) == pytest.approx(level)


def test_place_light_does_not_depend_on_the_size():
    picture = street(2)
    np.testing.assert_allclose(place_light(picture.repeat(20, 0).repeat(20, 1)), place_light(picture), rtol=1e-9)
    assert thumbnail(np.zeros((3000, 20, 3), np.uint8)).shape == (48, 1, 3)
    assert thumbnail(np.zeros((8, 8, 3), np.uint8)).shape == (8, 8, 3)


@pytest.mark.parametrize("azimuth", [-180, -60, 0, 90])
@pytest.mark.parametrize("elevation", [-90, -30, 0, 45, 90])
def test_place_light_with_a_direction_comes_from_there(azimuth, elevation):
    toward = direction(azimuth, elevation, "lamp")
    light = place_light(street(3), toward)
    main = luminance(light)[[3, 1, 2]]
    np.testing.assert_allclose(main / np.linalg.norm(main), toward, atol=1e-9)
    assert moment_eigenvalue(light) > 0


def test_place_light_is_possible_for_all_pictures():
    extremes = [np.full((36, 48, 3), color) for color in (np.zeros(3), np.ones(3), *np.eye(3))]
    quarter = np.outer(np.arange(36) < 18, np.arange(48) >= 24)
    extremes += [each[..., None] * np.ones(3) for each in (np.eye(48)[:36], quarter)]
    for picture in (*map(codes, extremes), *map(street, range(200))):
        assert moment_eigenvalue(place_light(picture)) > 0


def test_features_of_known_pictures():
    picture = np.full((2, 4, 3), 0.25)
    np.testing.assert_allclose(features(picture)[[0, 1, 2, 4, 5]], 0, atol=1e-12)
    picture[:, 2:] = 0.75  # columns at -1, -1/3, 1/3, 1
    picture[0] *= 2  # rows at 1 and -1
    picture[..., 2] *= 0.5
    across, up, clipped, contrast, red, blue = features(picture)
    assert across == pytest.approx((1 / 3 + 1) * (0.75 - 0.25) / (2 * (0.75 + 0.25)))
    assert up == pytest.approx((2 - 1) / (2 + 1))
    assert clipped == 0.25  # the two pixels of 1.5
    levels = np.array([0.5, 1.5, 0.25, 0.75])
    assert contrast == pytest.approx(np.log(levels.std() / levels.mean()))
    assert (red, blue) == (pytest.approx(0), pytest.approx(np.log(0.5)))
