from dataclasses import replace

import numpy as np
import pytest
from samples import render

from relight.core.srgb import LINEAR
from relight.lights import Light, load_light
from relight.maps.square import extent
from relight.panoramas import Panorama
from relight.photos.background import Background, estimate_white, read_background
from relight.photos.ground import Camera, _fill_with_balls, _transport, ground_under, standing_box
from relight.photos.look import Look
from relight.photos.mask.pose import Body
from relight.pictures.codes import to_srgb8
from relight.sh import basis, rotate_y, unoccluded

Y00 = 0.5 / np.sqrt(np.pi)
CAMERA = Camera(300.0, 150.0, 130.0)


def box_of(coverage):
    rows, columns = extent(coverage >= 128)
    return *rows, *columns


def standing(height=300, width=260, bottom=280, middle=130):
    """A person (H,W) uint8: a head, a body, two legs apart."""
    y, x = np.mgrid[:height, :width]
    y = (bottom - 1 - y) / 240  # heights of the person above the ground_under
    x = (x - middle) / 240
    head = np.hypot(x, y - 0.93) < 0.07
    body = (abs(x) < 0.13) & (y > 0.45) & (y < 0.85)
    legs = (abs(abs(x) - 0.07) < 0.04) & (y >= 0) & (y <= 0.45)
    return (head | body | legs) * np.uint8(255)


def lamp(azimuth, elevation):
    return load_light(f"key:#ffffff@{azimuth},{elevation}").coefficients.astype(np.float32)


@pytest.mark.parametrize(("centre", "radius"), [((0, 1, 0), 0.5), ((0.6, 0.8, 0), 0.5), ((-0.3, 0.8, 0.6), 0.3)])
def test_a_ball_hides_what_it_should(centre, radius, monkeypatch):
    """pi sin^2(edge) cos(tilt) of the irradiance from everywhere; a small one hides that much of Y in its direction."""
    distance = np.linalg.norm(centre)
    direction = np.array(centre) / distance

    def hidden(radius):
        found, whole = _transport(np.zeros((1, 3)), np.array([[*centre, radius]]), 2)
        assert np.abs(whole - unoccluded(np.array([0.0, 1, 0]), 2)).max() < 0.02
        return found[0] / (np.pi * (radius / distance) ** 2 * direction[1])

    assert hidden(radius)[0] == pytest.approx(Y00, rel=0.08)
    monkeypatch.setattr("relight.photos.ground.RAYS", 40_000)
    assert np.abs(hidden(0.1) - basis(direction, 2)).max() < 0.02


def test_balls_beside_each_other_add_and_behind_each_other_do_not():
    one, other = [1.0, 1.0, 0.0, 0.3], [-1.0, 1.0, 0.0, 0.3]
    behind = [2.0, 2.0, 0.0, 0.59]
    hide = lambda *balls: _transport(np.zeros((1, 3)), np.array(balls), 2)[0][0]  # noqa: E731
    assert np.allclose(hide(one, other), hide(one) + hide(other))
    assert np.allclose(hide(one, behind), hide(one))


@pytest.mark.slow
def test_a_figure_is_filled_and_stands_on_the_ground():
    coverage = standing()
    balls = _fill_with_balls(coverage, box_of(coverage), CAMERA)
    x, y = (130 - balls[:, 0] / balls[:, 2] * 300, 150 + balls[:, 1] / balls[:, 2] * 300)
    radius = -balls[:, 3] / balls[:, 2] * 300
    rows, columns = np.mgrid[:300, :260] + 0.5
    drawn = (np.hypot(columns[..., None] - x, rows[..., None] - y) < radius).any(-1)
    solid = coverage > 127
    assert (drawn & solid).sum() > 0.9 * solid.sum() and (drawn & ~solid).sum() < 0.02 * solid.sum()
    lowest = balls[np.argmax(y + radius)]
    assert lowest[1] - lowest[3] == pytest.approx(-1, abs=0.03)  # the ground_under, in heights of the camera


def test_each_foot_stands_where_it_is_seen_and_a_cane_is_none():
    """One foot farther up in the picture is one farther away."""
    coverage, cane = standing(), standing()
    coverage[265:, :130] = cane[240:281] = 0
    balls = _fill_with_balls(coverage, box_of(coverage), CAMERA)
    low = balls[balls[:, 1] < -0.85]
    left, right = low[low[:, 0] < 0], low[low[:, 0] > 0]
    assert -left[:, 2].mean() == pytest.approx(300 / 115, rel=0.03)
    assert -right[:, 2].mean() == pytest.approx(300 / 130, rel=0.02)
    cane[240:281, 130] = 255  # too thin to be filled
    assert np.isfinite(_fill_with_balls(cane, box_of(cane), CAMERA)).all()


def test_shadows_fall_away_from_the_light_and_end():
    ground = ground_under([standing()])
    h, w, _ = ground.occluded.shape
    here = int((280 - ground.rows[0]) / (ground.rows[1] - ground.rows[0]) * h)
    left, right = np.s_[:, : w // 3], np.s_[:, -w // 3 :]
    for azimuth, darker, lighter in ((75, left, right), (-75, right, left)):
        shade = ground.shadows(lamp(azimuth, 35)).mean(-1)
        assert shade[darker].mean() < shade[lighter].mean() - 0.01
    behind, front = ground.shadows(lamp(0, 30)).mean(-1), ground.shadows(lamp(180, 30)).mean(-1)
    assert behind[: here - 3].mean() < front[: here - 3].mean() and behind[here + 3 :].mean() > front[here + 3 :].mean()
    for name in ("room:3", "sky:5", "key:#ff2010@90,5", "key:#ffffff@0,-60"):
        shade = ground.shadows(load_light(name).coefficients)
        assert shade.min() > 0 and shade.max() <= 1 and np.isfinite(shade).all()
    even = np.zeros((9, 3), np.float32)
    even[0] = 1
    shade = ground.shadows(even)[..., 0]
    left, right = ground.columns
    under = shade[here - 2 : here + 1, int((130 - 17 - left) / (right - left) * w)]
    assert under.min() < 0.75 and shade[0].min() > 0.97  # contact; and faded at the far end
    assert np.allclose(ground.shadows(3 * even), ground.shadows(even))


def test_a_colored_lamp_leaves_the_other_color_in_its_shadow():
    light = lamp(70, 30) * [1.0, 0.5, 0.2]
    light[0] += np.array([0.0, 0.2, 0.6])
    shade = ground_under([standing()]).shadows(light)
    darkest = shade.reshape(-1, 3)[shade.sum(-1).argmin()]
    assert darkest[0] < darkest[1] < darkest[2]


def test_nobody_stands_in_a_portrait():
    coverage, other = standing(bottom=330), standing(middle=60)
    assert ground_under([coverage]) is None
    assert np.array_equal(ground_under([coverage, other]).occluded, ground_under([other]).occluded)


def body_with_feet(row, seen=0.9, height=300, width=260):
    """A body whose joints are all at its hips, but for the feet, which are in a row of the picture."""
    joints = np.tile(np.array([130 / width, 150 / height, 0.9], np.float32), (33, 1))
    joints[27:33] = 130 / width, row / height, seen
    return Body(joints, np.zeros((256, 256), np.float32), np.eye(2, 3) / 256, np.zeros((2, 2)))


def test_feet_are_where_joints_are(relighter):
    """A reflection on the floor, down to the lower edge, takes no shadow away; feet that are out of the photo do."""
    coverage = standing()
    mirrored = np.maximum(coverage, np.pad(coverage[:280][::-1], ((280, 0), (0, 0)))[:300])
    assert mirrored[299].any() and standing_box(mirrored) is None
    top, bottom, *columns = standing_box(mirrored, body_with_feet(275))
    assert (top, *columns) == standing_box(coverage)[:1] + standing_box(coverage)[2:] and abs(bottom - 280) <= 9
    for body in (body_with_feet(320), body_with_feet(275, seen=0.2)):
        assert standing_box(coverage, body) is None and ground_under([coverage], bodies=[body]) is None
    close, right = ground_under([mirrored], bodies=[body_with_feet(272)]), ground_under([coverage])
    light = lamp(70, 35)
    assert abs(close.shadows(light).mean() - right.shadows(light).mean()) < 0.05 and close.shadows(light).min() < 0.8
    scene = relighter.scene(np.full((300, 260, 3), 90, np.uint8), mirrored)
    look = Look("room:2", background="#445566")
    assert "no shadow on the new ground: its mask reaches" in scene.notes_on(look)[0]
    scene.people = [replace(scene.people[0], body=body_with_feet(320))]
    assert "no shadow on the new ground: no feet are seen" in scene.notes_on(look)[0]
    scene.people = [replace(scene.people[0], body=body_with_feet(275))]
    assert scene.notes_on(look) == scene.notes_on(Look("room:2")) == []


@pytest.mark.parametrize("kind", ["color", "picture", "panorama"])
@pytest.mark.slow
def test_shadows_are_on_new_backgrounds_only(kind, relighter, draw):
    """The picture is darker beneath the figure than without shadows, and nowhere else; so are frames of a movie."""
    pixels, mask = draw()
    scene = relighter.scene(pixels, mask)
    figures, grey = scene.people, np.full((180, 140, 3), 150, np.uint8)
    own = Light(scene.exposed(Look("room:2")).light, "me.png", Panorama(np.full((8, 16, 3), 0.1, np.float32)))
    look = Look(own, background=Background(kind, color=grey[0, 0], picture=grey), match=False)
    light, behind = scene.exposed(look)
    shaded = render(pixels, figures, light, "ratio", behind)
    without = render(pixels, figures, light, "ratio", replace(behind, shadow=False))
    away = mask == 0
    assert (shaded[away] <= without[away]).all() and shaded[away].mean() < without[away].mean() - 1
    assert np.array_equal(shaded[mask == 255], without[mask == 255])
    assert np.array_equal(shaded[:60][away[:60]], without[:60][away[:60]])
    first, second = scene.turned(look, (light, behind), [0, np.pi])
    turned = rotate_y(light, np.pi).astype(np.float32)
    assert np.array_equal(first, shaded)
    assert np.array_equal(second, render(pixels, figures, turned, "ratio", behind, turn=np.pi))
    assert np.array_equal(render(pixels, figures, light)[away], pixels[away])


def test_a_white_figure_in_the_open_is_as_bright_as_its_panorama():
    """The furnace: under the same radiance from everywhere nothing that is white can be told from what surrounds it."""
    radiance, light = np.array([0.2, 0.15, 0.1], np.float32), np.zeros((9, 3))
    light[0] = radiance / Y00
    seen = Background("panorama", panorama=Panorama(np.full((8, 16, 3), radiance, np.float32)), gain=1.0)
    for normal in ((0.0, 0, 1), (0.0, 1, 0)):
        assert np.abs(seen.linear((20, 20))[10, 10] - unoccluded(np.array(normal), 2) @ light).max() < 0.01


def test_a_picture_follows_the_lights_color_half_way(draw):
    """A neutral picture under a warm light warms; one that was taken in that light stays; brightness follows."""
    neutral = np.repeat(np.random.default_rng(0).integers(20, 230, (60, 50, 1)), 3, 2).astype(np.uint8)
    warm, light = np.array([1.0, 0.7, 0.4]), np.zeros((9, 3))
    light[0] = warm
    same = to_srgb8(LINEAR[neutral] * warm)
    assert np.abs(estimate_white(same) / estimate_white(same)[0] - warm).max() < 0.02
    for level in (1.0, 0.5):
        tinted = Background("picture", picture=neutral).matched(light, 1.0, level).tint
        assert np.allclose(tinted / tinted[0], np.sqrt(warm), atol=1e-3)
        kept = Background("picture", picture=same).matched(light, 1.0, level).tint
        assert kept == pytest.approx([level] * 3, rel=0.02)
    behind = Background("picture", picture=neutral)
    half = behind.matched(np.ones((9, 3)), 1.0, 0.5).linear((60, 50))
    assert np.allclose(half, behind.linear((60, 50)) / 2, atol=1e-3)
    color = read_background("#334455")
    assert np.array_equal(color.matched(light, 3.0, 0.5).linear((4, 4), stops=1), color.linear((4, 4)))
