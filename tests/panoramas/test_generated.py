import numpy as np
import pytest

from relight.lights import measure
from relight.panoramas import Panorama, generate_lamps, generate_room, generate_sky, project, radiosity
from relight.panoramas.color import XYZ_TO_RGB, blackbody, daylight
from relight.panoramas.projection import latlong_solid_angles
from relight.panoramas.radiosity import CELLS, AreaLight, Box, Grid, Lamp, Room, Sun
from relight.panoramas.rooms import CLEARANCE, sample_room


def lights_of(generate, count):
    return np.stack([project(Panorama(generate(seed))) for seed in range(count)])


def test_rooms_and_skies_are_physically_possible_and_few_rooms_are_dark_or_lit_from_below():
    rooms = measure(lights_of(generate_room, 60))
    assert rooms["moment"].min() > 0
    assert np.mean(rooms["reference"] < 0.2) < 0.12 and np.mean(rooms["elevation"] < 0) < 0.1
    skies = measure(lights_of(generate_sky, 60))
    assert skies["elevation"].min() > 5 and skies["moment"].min() > 0 and skies["first"].max() < np.sqrt(3)
    assert (skies["up"] > skies["down"]).all()


def test_every_room_has_a_source_of_light_and_nothing_is_close_to_the_camera():
    turn, reach = np.meshgrid(np.linspace(0, 2 * np.pi, 24, endpoint=False), [0.0, 0.3, 0.599])
    disc = np.stack([reach * np.sin(turn), 0 * turn, reach * np.cos(turn)], -1).reshape(-1, 3)
    assert CLEARANCE == 0.6
    for drawn in map(sample_room, map(np.random.default_rng, range(300))):
        assert ((drawn.camera > 0.3) & (drawn.camera < drawn.size - 0.3)).all() and (drawn.area_lights or drawn.lamps)
        around = (drawn.camera + disc)[:, [0, 2]]
        for box in drawn.boxes:  # neither beside the camera nor under it
            assert not np.all((around > box.low[[0, 2]]) & (around < box.high[[0, 2]]), axis=1).any()
        for lamp in drawn.lamps:
            assert np.linalg.norm(lamp.centre - drawn.camera) - lamp.radius > 0.6


def planck(temperature):
    """Linear Rec. 709 of a Planckian radiator: Planck's law against the CIE 1931 functions, as Wyman et al.
    2013 fit them (JCGT 2(2), table 1)."""
    nm = np.arange(360, 831.0)

    def lobe(centre, left, right):
        return np.exp(-0.5 * ((nm - centre) * np.where(nm < centre, left, right)) ** 2)

    x = 0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.0490, 0.0382)
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    spectrum = nm**-5.0 / np.expm1(1.438776877e7 / (nm * temperature))
    return XYZ_TO_RGB @ [(spectrum * matched).sum() for matched in (x, y, z)]


def ratios(rgb):
    return np.log(rgb[..., [0, 2]] / rgb[..., 1:2])


@pytest.mark.parametrize("temperature", [2300, 2856, 3200, 3999, 4001, 5000, 6500, 9000, 16000])
def test_black_bodies_have_the_color_of_plancks_law(temperature):
    np.testing.assert_allclose(ratios(blackbody(temperature)), ratios(planck(temperature)), atol=0.04)


def test_daylight_is_white_at_d65_and_a_little_green_of_the_black_body():
    np.testing.assert_allclose(daylight(6504), 1, atol=2e-3)
    for kelvin in (4500, 5500, 6999, 7001, 9000, 16000):
        assert (np.abs(ratios(daylight(kelvin)) - ratios(blackbody(kelvin)) + 0.06) < 0.06).all()


@pytest.mark.parametrize("generate", [generate_room, generate_sky, generate_lamps])
def test_panoramas_are_whole_and_the_same_from_the_same_seed(generate):
    first, again, other = generate(5), generate(5), generate(6)
    assert first.shape == (64, 128, 3) and first.dtype == np.float32
    for pixels in (first, generate(201208)):  # of the room of this seed, the first draw brings no light to the camera
        assert np.isfinite(pixels).all() and pixels.min() >= 0 and pixels.max() > 0
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_form_factors_sum_to_one_and_agree_with_a_closed_form():
    walls = Grid(np.zeros((1, 3)), np.full((1, 3), 4.0), CELLS, inside=True)
    factors = radiosity.form_factors(walls, walls)
    np.testing.assert_allclose(factors.sum(1), 1, atol=1e-9)
    ceiling, floor = slice(3 * CELLS**2, 4 * CELLS**2), slice(2 * CELLS**2, 3 * CELLS**2)
    # Opposite faces of a cube: 0.1998 (Howell, C-11).
    assert abs(factors[ceiling, floor].sum(1).mean() - 0.1998) < 0.02


@pytest.mark.parametrize("albedo", [0.3, 0.78])
def test_walls_absorb_all_light(albedo):
    """Light that spots of direct light bring is absorbed, no more and no less, in rooms of any shape; evenly lit walls
    have the closed form E / (1 - albedo)."""
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(12):
        size = np.array([[rng.uniform(2.8, 14), rng.uniform(2.3, 6), rng.uniform(2.8, 14)]])
        walls = Grid(np.zeros((1, 3)), size, CELLS, inside=True)
        factors, reflects = radiosity.form_factors(walls, walls), np.full((len(walls.area), 3), albedo)
        falls = np.zeros((len(walls.area), 3))
        falls[rng.integers(0, len(falls), 30)] = 1
        total = falls + radiosity.indirect_irradiance(factors, reflects, falls)
        shares.append(((1 - albedo) * walls.area @ total / (walls.area @ falls)).mean())
    assert abs(np.mean(shares) - 1) < 0.02 and np.ptp(shares) < 0.15
    even = np.ones((len(walls.area), 3))
    found = even + radiosity.indirect_irradiance(factors, reflects, even)
    np.testing.assert_allclose(found, 1 / (1 - albedo), rtol=0.01)


def test_a_lamp_obeys_the_inverse_square_and_throws_shadows():
    box = Box(np.array([1.5, 0.0, 1.5]), np.array([2.5, 1.0, 2.5]), np.full(3, 0.5))
    scene = Room(np.array([4.0, 3.0, 4.0]), np.array([0.5, 1.5, 0.5]), np.full((6, 3), 0.5), boxes=[box])
    scene.lamps.append(Lamp(np.array([2.0, 2.5, 2.0]), 0.1, np.full(3, 100.0)))
    up = np.array([[0.0, 1.0, 0.0]])
    free = radiosity.direct_irradiance(scene, np.array([[2.0, 1.0, 2.0]]), up)[
        0, 0
    ]  # on top of the box, 1.5 m below the lamp
    assert free == pytest.approx(100 * np.pi * 0.01 / (1.5**2 + 0.05), rel=0.01)
    floor = radiosity.direct_irradiance(scene, np.array([[2.7, 0.0, 2.0], [3.2, 0.0, 2.0]]), np.repeat(up, 2, 0))[:, 0]
    assert floor[0] == 0 < floor[1]  # the shadow of the box ends 0.83 m from its axis
    image = radiosity.render_room(scene)
    weight = np.repeat(latlong_solid_angles(64, 128), 128)
    lamp = image.reshape(-1, 3)[:, 0] > 5  # energy of the lamp's own pixels: radiance times its true solid angle
    distance = np.linalg.norm(scene.lamps[0].centre - scene.camera)
    true = 100 * 2 * np.pi * (1 - np.sqrt(1 - (0.1 / distance) ** 2))
    assert (image.reshape(-1, 3)[lamp, 0] * weight[lamp]).sum() == pytest.approx(true, rel=1e-6)


def test_the_sun_falls_where_the_window_lets_it():
    window = AreaLight(1, np.array([4.0, 1.0, 1.0]), np.array([4.0, 2.0, 2.0]), np.ones(3), daylight=True)
    scene = Room(np.array([4.0, 3.0, 4.0]), np.full(3, 1.5), np.full((6, 3), 0.5), [window])
    toward = np.array([1.0, 0.5, 0.0]) / np.sqrt(1.25)
    points = np.array([[1.0, 0.0, 1.5], [3.5, 0.0, 1.5], [1.0, 0.0, 3.0]])  # in the beam, below it, beside it
    assert radiosity.is_sunlit(scene, Sun(toward, np.ones(3)), points).tolist() == [True, False, False]
    distance, wall = radiosity.intersect_walls(scene.size, points[:1], toward[None])
    assert wall[0] == 1 and distance[0] == pytest.approx(3 * np.sqrt(1.25))
