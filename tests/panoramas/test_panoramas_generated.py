import numpy as np
import pytest

from relight.lights.statistics import measure
from relight.panoramas.layouts import latlong_solid_angles
from relight.panoramas.panorama import Panorama
from relight.panoramas.project import project
from relight.panoramas.radiosity import CELLS, Grid, direct, form_factors, render, sunlit, walls_hit
from relight.panoramas.rooms import Box, Lamp, Patch, Room, draw_room, room
from relight.panoramas.skies import sky

COUNT = 160


def lights_of(generate, count):
    return np.stack([project(Panorama(generate(seed))) for seed in range(count)])


@pytest.fixture(scope="module")
def rooms():
    return measure(lights_of(room, COUNT))


# Tenth, median and ninetieth of 16 measured indoor maps, and how far ours may be from each.
MEASURED = {
    "first": ((0.57, 0.86, 1.16), 0.12),
    "second": ((0.30, 0.85, 1.62), 0.35),
    "elevation": ((11, 51, 81), 12),
    "up": ((0.92, 1.46, 2.57), 0.4),
    "down": ((0.16, 0.32, 0.57), 0.12),
    "side_least": ((0.19, 0.37, 0.80), 0.18),
    "side_most": ((1.05, 2.08, 2.37), 0.5),
    "red": ((-0.19, 0.16, 0.38), 0.2),
    "blue": ((-0.27, -0.08, 0.19), 0.2),
}


@pytest.mark.parametrize("name", MEASURED)
def test_rooms_have_the_statistics_of_measured_rooms(rooms, name):
    target, tolerance = MEASURED[name]
    np.testing.assert_allclose(np.percentile(rooms[name], [10, 50, 90]), target, atol=tolerance)


def test_rooms_can_exist_and_few_are_dark_or_lit_from_below(rooms):
    assert rooms["moment"].min() > 0
    assert np.mean(rooms["reference"] < 0.2) < 0.1
    assert np.mean(rooms["elevation"] < 0) < 0.06


def test_every_room_has_a_source_of_light_and_room_for_the_camera():
    for seed in range(3000):
        drawn = draw_room(np.random.default_rng(seed))
        assert drawn.patches or drawn.lamps
        assert (drawn.camera > 0).all() and (drawn.camera < drawn.size).all()
        assert all(np.any((drawn.camera < box.low) | (drawn.camera > box.high)) for box in drawn.boxes)


@pytest.mark.parametrize("generate", [room, sky])
def test_panoramas_are_whole_and_the_same_from_the_same_seed(generate):
    first, again, other = generate(5), generate(5), generate(6)
    assert first.shape == (64, 128, 3) and first.dtype == np.float32
    assert np.isfinite(first).all() and first.min() >= 0 and first.max() > 0
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_skies_are_lit_from_above_and_can_exist():
    m = measure(lights_of(sky, 60))
    assert m["elevation"].min() > 5 and m["moment"].min() > 0 and m["first"].max() < np.sqrt(3)
    assert (m["up"] > m["down"]).all()


def furnace(albedo=0.5):
    """A closed room whose every wall shines alike: radiance 1 / (1 - albedo) everywhere, whatever its shape."""
    size = np.array([4.0, 3.0, 5.0])
    walls = Room(size, size / 2, np.full((6, 3), albedo))
    for wall in range(6):
        low, high = np.zeros(3), size.copy()
        low[wall // 2] = high[wall // 2] = size[wall // 2] * (wall % 2)
        walls.patches.append(Patch(wall, low, high, np.ones(3)))
    return walls


def test_form_factors_close_the_room_and_see_the_floor_from_the_ceiling():
    size = np.array([[4.0, 4.0, 4.0]])
    walls = Grid(np.zeros((1, 3)), size, CELLS, inside=True)
    factors = form_factors(walls, walls)
    np.testing.assert_allclose(factors.sum(1), 1, atol=1e-9)
    ceiling, floor = slice(3 * CELLS**2, 4 * CELLS**2), slice(2 * CELLS**2, 3 * CELLS**2)
    # Opposite faces of a cube: 0.1998 (Howell, C-11).
    assert abs(factors[ceiling, floor].sum(1).mean() - 0.1998) < 0.02


def test_a_wall_of_light_gives_the_irradiance_of_half_a_space():
    lit = furnace()
    cells = Grid(np.zeros((1, 3)), lit.size[None], CELLS, inside=True)
    centre = 3 * CELLS**2 + CELLS * CELLS // 2 + CELLS // 2  # the middle of the ceiling sees all but its own patch
    irradiance = direct(lit, cells.position, cells.normal)[centre]
    np.testing.assert_allclose(irradiance, np.pi, rtol=0.15)  # 2 x 2 samples a wall


def test_a_lamp_obeys_the_inverse_square_and_throws_shadows():
    box = Box(np.array([1.5, 0.0, 1.5]), np.array([2.5, 1.0, 2.5]), np.full(3, 0.5))
    scene = Room(np.array([4.0, 3.0, 4.0]), np.array([0.5, 1.5, 0.5]), np.full((6, 3), 0.5), boxes=[box])
    scene.lamps.append(Lamp(np.array([2.0, 2.5, 2.0]), 0.1, np.full(3, 100.0)))
    up = np.array([[0.0, 1.0, 0.0]])
    free = direct(scene, np.array([[2.0, 1.0, 2.0]]), up)[0, 0]  # on top of the box, 1.5 m below the lamp
    assert free == pytest.approx(100 * np.pi * 0.01 / (1.5**2 + 0.05), rel=0.01)
    floor = direct(scene, np.array([[2.7, 0.0, 2.0], [3.2, 0.0, 2.0]]), np.repeat(up, 2, 0))[:, 0]
    assert floor[0] == 0 < floor[1]  # the shadow of the box ends 0.83 m from its axis
    image = render(scene)
    weight = np.repeat(latlong_solid_angles(64, 128), 128)
    lamp = image.reshape(-1, 3)[:, 0] > 5  # energy of the lamp's own pixels: radiance times its true solid angle
    distance = np.linalg.norm(scene.lamps[0].centre - scene.camera)
    true = 100 * 2 * np.pi * (1 - np.sqrt(1 - (0.1 / distance) ** 2))
    assert (image.reshape(-1, 3)[lamp, 0] * weight[lamp]).sum() == pytest.approx(true, rel=1e-6)


def test_the_sun_falls_where_the_window_lets_it():
    window = Patch(1, np.array([4.0, 1.0, 1.0]), np.array([4.0, 2.0, 2.0]), np.ones(3), daylight=True)
    scene = Room(np.array([4.0, 3.0, 4.0]), np.full(3, 1.5), np.full((6, 3), 0.5), [window])
    toward = np.array([1.0, 0.5, 0.0]) / np.sqrt(1.25)
    scene.sun = toward, np.ones(3)
    points = np.array([[1.0, 0.0, 1.5], [3.5, 0.0, 1.5], [1.0, 0.0, 3.0]])  # in the beam, below it, beside it
    assert sunlit(scene, points).tolist() == [True, False, False]
    distance, wall = walls_hit(scene.size, points[:1], toward[None])
    assert wall[0] == 1 and distance[0] == pytest.approx(3 * np.sqrt(1.25))
