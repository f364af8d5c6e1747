from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from samples import render
from scipy.ndimage import gaussian_filter

from relight.core.srgb import LINEAR, LUMINANCE, encode, to_linear
from relight.maps import square
from relight.maps.square import crop_around
from relight.panoramas import luminance
from relight.photos import shading
from relight.photos.background import Background, read_background
from relight.photos.person import Person, balanced, infer_person
from relight.photos.render import estimate_foreground, over
from relight.photos.scene import Scene
from relight.photos.shading import FLOOR, exposure_factor, gain, shade, shading_floor
from relight.photos.tone import apply_gain
from relight.photos.write import layers
from relight.pictures.codes import to_codes, to_srgb8
from relight.pictures.picture import Picture
from relight.sh import UNOCCLUDED_T00, rotate_y, unoccluded
from relight.viewer.source import photo_figure

LIGHT = np.zeros((9, 3), np.float32)
LIGHT[0], LIGHT[1], LIGHT[2], LIGHT[3] = (0.7, 0.75, 0.8), 0.2, (0.3, 0.25, 0.2), (0.2, 0.1, 0.0)
OTHER = np.zeros((9, 3), np.float32)
OTHER[0], OTHER[1], OTHER[2], OTHER[3], OTHER[8] = (0.9, 0.7, 0.5), 0.1, 0.2, -0.35, 0.1


def ball(size=128, side=160):
    """A figure whose maps are known: a matte ball, photographed with the network's pixels lying on the photo's."""
    axis = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(axis / 0.9, -axis / 0.9)
    mask = np.hypot(x, y) < 1
    normal = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))], -1)
    transport = (unoccluded(normal, 2) * mask[..., None]).astype(np.float32)
    albedo = ((mask * (0.75 + 0.25 * np.sin(20 * x)))[..., None] * [0.6, 0.4, 0.3]).astype(np.float32)
    coverage = np.zeros((side, side), np.uint8)
    coverage[10 : 10 + size, 20 : 20 + size] = mask * np.uint8(255)
    place = replace(crop_around(coverage, size), top=10.0, left=20.0, side=float(size))
    image = albedo * shade(transport, LIGHT)
    figure = Person(place, coverage, mask, image, albedo, transport, LIGHT)
    pixels = np.full((side, side, 3), 90, np.uint8)
    pixels[10 : 10 + size, 20 : 20 + size][mask] = to_srgb8(image)[mask]
    return pixels, figure, mask


@pytest.mark.parametrize("size", [(180, 140), (141, 333), (200, 200), (64, 30)])
@pytest.mark.slow
def test_photo_in_photo_out(relighter, size, draw):
    """`ratio` with the inferred light returns the very photo, whatever the network says."""
    pixels, mask = draw(*size, seed=sum(size))
    figures = relighter.infer(pixels, mask)
    for background_ in (None, Background("transparent")):
        out = render(pixels, figures, figures[0].light, "ratio", background_)
        inside = (figures[0].coverage == 255) if background_ else np.ones(mask.shape, bool)
        assert np.array_equal(out[..., :3][inside], pixels[inside])
    assert 0 < figures[0].error < 1


def test_several_people_each_by_their_own_light(relighter, draw):
    pixels, mask = draw()
    two, both = np.concatenate([pixels, pixels[:, ::-1]], 1), np.concatenate([mask, mask], 1)
    figures = relighter.infer(two, both, white_balance="scene")
    assert len(figures) == 2
    for figure in figures:
        assert np.array_equal(render(two, [figure], figure.light), two)
    alone = relighter.infer(pixels, mask, white_balance="scene")
    assert np.abs(alone[0].light - figures[0].light).max() < 1e-5  # the neighbour changes nothing
    assert len(relighter.infer(two, both, split=False)) == 1


def test_known_ball_is_relit_right():
    pixels, figure, mask = ball()
    expected = figure.albedo * shade(figure.transport, OTHER)
    floor = shading_floor(figure.shading, mask)
    sure = mask & (figure.shading.min(-1) > 2 * floor) & (expected.max(-1) < 0.75) & (figure.image.min(-1) > 0.05)
    assert sure.sum() > 0.5 * mask.sum()
    for mode in ("ratio", "full"):
        error = np.abs(LINEAR[render(pixels, [figure], OTHER, mode)[10:138, 20:148]] - expected)[sure]
        assert error.max() < 0.02 and error.mean() < 0.002, mode
        assert np.array_equal(render(pixels, [figure], OTHER, mode)[figure.coverage == 0], pixels[figure.coverage == 0])


def test_a_tinted_light_is_the_photos_white():
    """A grey card that is inferred to lie in tinted light: its white lamp keeps the photo's colors; without, not."""
    pixels, figure, mask = ball()
    tint, flat = np.array([1.3, 0.95, 0.65], np.float32), np.zeros((9, 3), np.float32)
    flat[0] = 0.8
    grey = {"albedo": np.full_like(figure.albedo, 0.4) * mask[..., None], "light": flat * tint}
    card = replace(figure, transport=figure.transport * (np.arange(9) == 0), **grey)
    (kept,) = balanced([card])
    assert np.allclose(kept.white, tint / (tint @ LUMINANCE), atol=1e-5) and np.ptp(kept.light, axis=1).max() < 1e-5
    assert np.allclose(kept.shading @ LUMINANCE, card.shading @ LUMINANCE, atol=1e-5)
    assert np.allclose(kept.albedo * kept.shading, card.albedo * card.shading)
    assert np.array_equal(render(pixels, [kept], kept.light), pixels)
    strong = np.array([4.0, 1.0, 0.1], np.float32)
    assert balanced([replace(card, light=flat * strong)])[0].white.min() == pytest.approx(0.2)  # held
    solid = card.coverage == 255
    neutral = LINEAR[render(pixels, [card], flat)][solid] / LINEAR[pixels][solid]
    assert np.abs(neutral / neutral[:, 1:2] * tint / tint[1] - 1)[(pixels[solid] > 40).all(1)].max() < 0.1


def test_people_of_a_photo_share_its_white():
    """A small and a large person in lights of two colors: the mean over their pixels becomes white."""
    _, figure, mask = ball()
    one, two = balanced([figure, replace(figure, light=OTHER, crop=replace(figure.crop, side=2 * figure.crop.side))])
    mean = one.shading[mask].mean(0) + 4 * two.shading[mask].mean(0)
    assert np.array_equal(one.white, two.white) and np.ptp(mean) < 1e-4 * mean[0]


def test_exposure_matches_itself_and_does_not_turn():
    _, figure, mask = ball()
    assert exposure_factor(LIGHT, LIGHT, figure.transport, mask) == pytest.approx(1)
    assert exposure_factor(LIGHT, 5 * LIGHT, figure.transport, mask) == pytest.approx(0.2)
    for color, level in (((1, 0.8, 0.6), 1.0), ((1, 0.2, 0.05), 0.6), ((0, 0, 1), 0.6)):  # the last two would burn
        lamp = LIGHT.mean(1, keepdims=True) * np.float32(color)
        factor = exposure_factor(LIGHT.mean(1, keepdims=True) * np.ones(3, np.float32), lamp, figure.transport, mask)
        assert factor * (luminance(np.array(color)) if level == 1 else 0.6) == pytest.approx(1, rel=1e-4)
    turned = [rotate_y(OTHER, angle).astype(np.float32) for angle in (0, 1, 2.51)]
    shown = [exposure_factor(LIGHT, light, figure.transport, mask) * light for light in turned]
    means = [luminance(shade(figure.transport, light))[mask].mean() for light in (LIGHT, *shown)]
    np.testing.assert_allclose(means, means[0], rtol=1e-5, err_msg="as bright as before at the heading that is shown")
    factors = [exposure_factor(LIGHT, light, figure.transport, mask, turning=True) for light in turned]
    assert np.ptp(factors) < 3e-3 * factors[0]
    # over a whole turn no figure gets brighter than it could be under the photo's own light
    turns = np.arange(90) * np.pi / 45
    under = [
        max(shade(figure.transport, rotate_y(k * light, a))[mask].mean() for a in turns)
        for light, k in ((LIGHT, 1.0), (OTHER, factors[0]))
    ]
    assert under[1] == pytest.approx(under[0], rel=0.1)  # channels differ, luminance is equal


def test_the_brightest_turn_is_that_of_all_turns():
    rng = np.random.default_rng(4)
    for count in (9, 16, 4):
        transport, light = rng.normal(size=count), rng.normal(size=(count, 3))
        grey = light @ [0.2126, 0.7152, 0.0722]
        angles = 2 * np.pi * np.arange(shading.ANGLES) / shading.ANGLES
        turns = [transport @ rotate_y(grey[:, None], angle)[:, 0] for angle in angles]
        assert shading.max_luminance(transport, light) == pytest.approx(max(turns), rel=1e-3)


def gain_of(old, new, color=(1, 1, 1), new_color=(1, 1, 1)):
    """`gain` for shadings (N,3) under lights of these mean colors, of a person whose other pixels all have 1."""
    transport, light, new_light = np.zeros((len(old) + 20_000, 9)), np.zeros((9, 3)), np.zeros((9, 3))
    transport[: len(old), 1:7] = np.concatenate([old, new], 1)
    transport[len(old) :, 1:7] = 1
    light[0], new_light[0] = (np.divide(mean, UNOCCLUDED_T00) for mean in (color, new_color))
    light[1:4] = new_light[4:7] = np.eye(3)
    return gain(transport, np.ones(len(transport), bool), light, new_light)[: len(old)]


def test_gain_of_dark_shading_does_not_blow_up():
    old, new = np.array([[0.001] * 3, [0.8] * 3]), np.ones((2, 3))
    np.testing.assert_allclose(gain_of(old, new)[:, 0], [1 / FLOOR, 1 / 0.8], rtol=1e-3)
    assert (gain_of(old, old) == 1).all()
    assert shading_floor(old[None], np.ones((1, 2), bool)) == pytest.approx(FLOOR * 0.4005)
    assert (shade(np.array([[1.0, 0, 0, 0]]), np.full((4, 3), -1.0)) == 0).all()


def test_gain_of_a_dark_grey_fold_under_a_strong_lamp_is_grey():
    """What is inferred of a fold is off by a hue; its codes are off by their rounding. Light brings out neither."""
    rng = np.random.default_rng(0)
    truth = np.linspace(0.02, 0.15, 200)[:, None] * np.ones(3)  # shading of the fold; elsewhere 1
    codes = np.rint(255 * encode(0.5 * truth)).astype(np.uint8)
    old = np.maximum(truth + 0.15 * (rng.random((200, 3)) - 0.5), 0).astype(np.float32)
    new = np.ones_like(old)
    plain, found = (apply_gain(LINEAR[codes], factor) for factor in (new / np.maximum(old, FLOOR), gain_of(old, new)))
    assert (plain.max(-1) / plain.min(-1)).max() > 2
    assert (found.max(-1) / found.min(-1)).max() < 1 + 0.25
    bright = rng.uniform(2 * shading.DARK, 2, (50, 3))  # the gain of bright shading is new / old
    lit = rng.uniform(2 * shading.DARK, 2, (50, 3))
    np.testing.assert_allclose(gain_of(bright, lit), lit / bright, rtol=1e-5)
    assert (gain_of(old, old) == 1).all()


def test_gain_in_the_shade_of_a_warm_lamp_has_its_color():
    """Also where red has rung below zero and blue has not; shade is raised to the floor as a whole."""
    warm = np.array([1.2, 1, 0.6])
    new = np.array([[0.02, 0.01, 0.005], [0.0, 0.0, 0.0], [-0.1, 0.01, 0.05], [0.14, 0.14, 0.14]])
    found = gain_of(np.ones_like(new), new, new_color=warm)
    np.testing.assert_allclose(found[:3], FLOOR * np.outer(np.ones(3), warm / (warm @ LUMINANCE)), rtol=1e-3)
    np.testing.assert_allclose(found[3] @ LUMINANCE, 0.14, rtol=1e-3)


def test_steady_shading_is_never_negative_and_continuous():
    light = np.eye(9, 3) + 0.1
    levels = np.linspace(-0.2, 2, 2000)[:, None] * [1.2, 0.9, 0.3]
    found = shading.steady(levels, light)
    assert found.min() >= 0 and np.abs(np.diff(found, axis=0)).max() < 0.01
    np.testing.assert_array_equal(found[-1000:], levels[-1000:])


def cut_out(pixels, mask, hidden):
    """An image of Pillow that is transparent around a person, with a color under it."""
    return Image.fromarray(np.dstack([np.where(mask[..., None] > 0, pixels, np.array(hidden, np.uint8)), mask]))


@pytest.mark.parametrize("edge", ["soft", "hard"])
@pytest.mark.parametrize("background", ["keep", "transparent", "#334455"])
def test_a_cut_out_stays_one_and_hidden_colors_do_not_matter(relighter, draw, background, edge):
    pixels, mask = draw()
    mask = mask if edge == "soft" else np.where(mask > 127, np.uint8(255), np.uint8(0))
    images = (cut_out(pixels, mask, hidden) for hidden in ((255, 0, 255), (0, 90, 0)))
    one, other = (relighter.relight(image, None, LIGHT, background=background) for image in images)
    np.testing.assert_array_equal(one[mask > 0], other[mask > 0])
    if background != "#334455":
        np.testing.assert_array_equal(one[..., 3], mask)
    if edge == "soft":
        whole = relighter.relight(pixels, mask, LIGHT, background=background)
        np.testing.assert_array_equal(one[mask == 255][:, :3], whole[mask == 255][:, :3])


def test_a_cut_out_is_relit_as_the_picture_that_it_is_put_into(relighter, draw):
    """Straight colors times a gain, then composited, are the composite with the person relit."""
    pixels, mask = draw()
    alpha = mask[..., None] / 255
    behind = np.full(3, 60, np.uint8)
    picture = to_codes(alpha * to_linear(pixels) + (1 - alpha) * to_linear(behind), np.uint8)
    cut = relighter.relight(cut_out(pixels, mask, (0, 0, 0)), None, LIGHT)
    both = alpha * to_linear(cut[..., :3]) + (1 - alpha) * to_linear(behind)
    assert np.abs(to_linear(relighter.relight(picture, mask, LIGHT)) - both)[mask < 255].mean() < 0.003


def test_people_who_touch_pass_into_each_other():
    """Where both have a share of a pixel, its gain is the mean of theirs, 2 and 1, and so is its transport."""
    left = np.clip(np.linspace(300, -45, 64), 0, 255).round().astype(np.uint8) * np.ones((64, 1), np.uint8)
    pixels, light = np.full((64, 64, 3), 0.1, np.float32), np.zeros((9, 3), np.float32)
    light[0], flat = 1, np.ones((16, 16, 3), np.float32)
    mask, transport = np.ones((16, 16), bool), np.full((16, 16, 9), 0.5, np.float32)
    people = [
        Person(crop_around(share, 16), share, mask, 0.1 * flat, flat, factor * transport, light / factor)
        for share, factor in ((left, 2), (255 - left, 1))
    ]
    gains = 1 + left / 255
    np.testing.assert_allclose(render(pixels, people, light), 0.1 * gains[..., None] * np.ones(3), rtol=1e-5)
    scene = Scene(Picture.of(np.full((64, 64, 3), 90, np.uint8)), people)
    channels, figure = layers(scene)[0], photo_figure(scene)
    np.testing.assert_allclose(channels["transport.L0M0.Y"], 0.5 * gains, rtol=1e-3)  # half floats
    np.testing.assert_allclose(figure.maps.transport[..., 0], 0.5 * gains, rtol=1e-5)


def test_parts_do_not_show(relighter, monkeypatch, draw):
    pixels, mask = draw()
    given = pixels, relighter.infer(pixels, mask), OTHER, "ratio", Background("color", color=np.array([10, 200, 30]))
    whole = render(*given)
    monkeypatch.setattr(square, "TILE", 37)
    assert np.abs(render(*given).astype(int) - whole).max() <= 1


@pytest.mark.slow
def test_backgrounds(relighter, tmp_path, draw):
    pixels, mask = draw()
    figures = relighter.infer(pixels, mask)
    mask = figures[0].coverage
    blocks = np.random.default_rng(0).integers(0, 256, (90, 70, 3)).astype(np.uint8)
    Image.fromarray(blocks).resize((140, 180), 0).save(tmp_path / "b.png")
    keep, green, behind, clear = (
        render(pixels, figures, OTHER, "ratio", replace(read_background(name), shadow=False))
        for name in ("keep", "#10c81e", str(tmp_path / "b.png"), "transparent")
    )
    away, picture = mask == 0, np.asarray(Image.open(tmp_path / "b.png"))
    assert np.array_equal(keep[away], pixels[away]) and (keep[mask == 255] != pixels[mask == 255]).any()
    assert (green[away] == [16, 200, 30]).all()
    assert np.array_equal(green[mask == 255], keep[mask == 255])  # the figure does not depend on what is behind
    assert np.array_equal(behind[away], picture[away])
    assert clear.shape[2] == 4 and np.array_equal(clear[..., 3], mask)
    soft = read_background(str(tmp_path / "b.png"), blur=3).linear((180, 140))
    sigma = np.radians(3) * 90 / np.tan(np.radians(25))
    expected = gaussian_filter(LINEAR[picture], (sigma, sigma, 0), mode="nearest")
    assert np.abs(soft - expected)[30:-30, 30:-30].max() < 0.02 and soft.std() < 0.5 * LINEAR[behind].std()


@pytest.mark.slow
def test_paper_networks_see_coded_values(relighter, weights, draw):
    pixels, mask = draw()
    networks = (replace(relighter.network, config={"train": {"color": color}}) for color in ("paper", "photo"))
    paper, photo = (infer_person(network, pixels, mask) for network in networks)
    assert np.abs(to_srgb8(photo.image) / 255.0 - paper.image)[photo.mask].max() < 0.003
    assert np.array_equal(render(pixels, [paper], paper.light), pixels)


def test_a_picture_behind_fills_the_photo_and_is_cut_around_its_middle():
    columns = np.broadcast_to(np.arange(14, dtype=np.uint8)[:, None] * 18, (8, 14, 3))
    behind = Background("picture", picture=np.ascontiguousarray(columns))
    assert np.array_equal(to_srgb8(behind.linear((8, 8))), columns[:, 3:-3])
    assert behind.linear((9, 17)).shape == (9, 17, 3)  # where the corner of the cut would be rounded to less than 0


def test_no_halo_on_a_new_background_and_opaque_pixels_stay():
    """A soft disc whose color changes slowly, before a bright background; a hard mask changes nothing."""
    y, x = np.mgrid[:200, :200] - 100
    alpha = np.clip(0.5 + (60 - np.hypot(x, y)) / 12, 0, 1).astype(np.float32)
    y, x = np.mgrid[:200, :200] / 200
    figure = np.stack([0.2 + 0.1 * x, 0.1 + 0.05 * y, 0.15 + 0 * x], -1).astype(np.float32)
    behind = np.stack([0.8 + 0.1 * y, 0.9 + 0 * x, 0.95 - 0.1 * x], -1).astype(np.float32)
    new, photo = np.full_like(figure, 0.02), over(figure, alpha, behind)
    found = estimate_foreground(photo, alpha)
    naive, good = (np.abs(over(front, alpha, new) - over(figure, alpha, new)).max() for front in (photo, found))
    assert naive > 0.15 and good < 0.02  # the halo
    assert np.array_equal(found[alpha == 1], photo[alpha == 1])
    assert estimate_foreground(photo, (alpha > 0.5).astype(np.float32)) is photo
