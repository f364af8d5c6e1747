from dataclasses import replace

import numpy as np
import pytest

from relight.benchmark import make
from relight.benchmark import recipes as recipes_module
from relight.benchmark.lights import Lamplight, panorama, resampled
from relight.benchmark.recipes import HASHES, digest, draw_recipe, draw_recipes, with_gloss
from relight.core.errors import UserError
from relight.lights.load import GENERATED
from relight.lights.statistics import reference_brightness
from relight.meshes import Material, Mesh
from relight.panoramas import Panorama, project
from relight.panoramas.polyhaven import NAMES
from relight.sh import basis, rotation_matrix
from relight.transport.tracer import sky_directions, sky_weights
from relight.transport.view import View


def test_draw_recipes_of_real_lights():
    """A photograph and its four new lights are five panoramas, and each of the eighteen is used about as often."""
    made = draw_recipes("real")
    lights = [[one.seed for one in (r.light, *r.new)] for r in made]
    assert all(one.kind == "real" for r in made for one in (r.light, *r.new))
    assert all(len(set(seeds)) == 5 for seeds in lights)
    counts = np.bincount(np.ravel(lights), minlength=len(NAMES))
    assert len(counts) == len(NAMES) == 18 and counts.min() > 20 and counts.max() < 55
    generated = draw_recipe(made[0].seed, 1)
    assert replace(made[0], light=generated.light, new=generated.new) == generated


def test_panorama_of_a_real_place_keeps_the_power_of_its_sun(monkeypatch, tmp_path):
    """A sun of one pixel, turned and tipped, still has its share of the light."""
    monkeypatch.setenv("RELIGHT_DATA", str(tmp_path))
    pixels = np.full((256, 512, 3), 0.1, np.float32)
    pixels[60, 130] = 5000
    (tmp_path / "panoramas").mkdir()
    make.write_panorama(tmp_path / "panoramas" / f"{NAMES[3]}.exr", Panorama(pixels))
    light = project(Panorama(pixels), 2)[:, 1]
    for yaw in (0.0, 32.0, 77.0, 181.0):
        found = project(panorama(Lamplight("real", 3, 0.0, yaw), 5.0, 0.6), 2)[:, 1]
        assert np.linalg.norm(found[1:4]) / found[0] == pytest.approx(np.linalg.norm(light[1:4]) / light[0], rel=0.03)


def test_make_refuses_changed_recipes_and_needs_the_panoramas_of_real_lights(monkeypatch, painter, tmp_path, settings):
    monkeypatch.setenv("RELIGHT_DATA", str(tmp_path))
    with pytest.raises(UserError, match="not set up: run once `relight light setup`"):
        make.make(tmp_path / "set", "real", 1, settings)
    monkeypatch.setattr(recipes_module, "TINT", 0.16)
    with pytest.raises(RuntimeError, match="those of a published set must not"):
        make.make(tmp_path, "report", None, settings)


def test_draw_recipes_gives_the_published_sets_and_refuses_other_names_and_counts():
    assert {kind: digest(draw_recipes(kind)) for kind in HASHES} == HASHES
    with pytest.raises(UserError, match="--set best: must be report or choose or real"):
        draw_recipes("best")
    with pytest.raises(UserError, match="--count 0"):
        draw_recipes("report", 0)
    assert draw_recipes("choose", 5) == draw_recipes("choose")[:5]


def test_with_gloss_depends_on_the_seed():
    def gloss(seed, materials):
        none = np.zeros((0, 3))
        mesh = with_gloss(Mesh(none, none, none, none, [Material()] * materials), seed)
        return [(one.roughness, one.specular) for one in mesh.materials]

    assert gloss(7, 5)[:3] == gloss(7, 3) and gloss(7, 3) != gloss(8, 3)
    assert gloss(900_000, 2) == [(0.703, 0.264), (0.741, 0.256)]  # as the pictures of the set were drawn


@pytest.mark.parametrize("kind", GENERATED)
def test_panorama_is_scaled_tinted_and_pitched(kind):
    level = panorama(Lamplight(kind, 7, 0.0, 0.0), 0.0, 0.6)
    picture = GENERATED[kind](7)
    assert np.allclose(level.pixels / level.pixels.max(), picture / picture.max(), atol=1e-5)
    assert float(reference_brightness(project(level, 2))) <= 0.6 + 1e-6
    # Tipped by the pitch of the camera, as its frame is; what is at the poles and in small lamps is resampled.
    tipped = panorama(Lamplight(kind, 7, 0.0, 0.0), 20.0, 0.6)
    light = project(level, 2)
    expected = rotation_matrix(View(pitch=20).rotation, 2) @ light
    found = project(tipped, 2) * light[0, 1] / project(tipped, 2)[0, 1]
    assert np.linalg.norm(found - expected) < 0.05 * np.linalg.norm(expected)
    assert np.linalg.norm(found - light) > 0.05 * np.linalg.norm(expected)
    change = panorama(Lamplight(kind, 7, -0.4, 0.0), 0.0, 0.6).pixels.mean((0, 1)) / level.pixels.mean((0, 1))
    assert np.isclose(np.log(change[2] / change[1]), -0.4, atol=1e-4) and change[0] > change[1]


def test_resampled_keeps_the_light():
    found = panorama(Lamplight("room", 11, 0.1, 30.0), 5.0, 0.7)
    light = np.einsum("hw,hwk,hwc->kc", sky_weights(), basis(sky_directions()), resampled(found))
    assert np.allclose(light, project(found, 2), atol=0.01 * np.abs(light).max())
