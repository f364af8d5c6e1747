import re

import numpy as np
import pytest
from PIL import Image

import relight
from relight.core.errors import UserError
from relight.lights import Light, load_light
from relight.panoramas import luminance
from relight.photos.background import read_background
from relight.photos.inferred import degrees_apart, read_light
from relight.photos.look import Look
from relight.sh import deringed

LIGHT = "key:#ffeedd@60,20"


def test_every_kind_of_picture_gives_the_same(relighter, photo_files):
    me, beside, pixels, mask = photo_files
    usual = relighter.relight(pixels, mask, LIGHT)
    assert not np.array_equal(usual, pixels)
    pairs = [(me, beside), (str(me), str(beside)), (me, mask), (pixels, beside), (pixels, mask / 255)]
    pairs += [(Image.fromarray(pixels), Image.fromarray(mask)), (Image.open(me), beside)]
    for given in (*pairs, (me, None)):  # me_mask.png is found
        assert np.array_equal(relighter.relight(*given, LIGHT), usual), given
    assert np.array_equal(relighter.infer(me)[0].light, relighter.infer(pixels, mask)[0].light)
    grey = pixels[..., 1]
    of_color = relighter.relight(np.dstack([grey] * 3), mask, LIGHT)
    assert np.array_equal(relighter.relight(grey, mask, LIGHT), of_color)
    assert np.array_equal(relighter.relight(Image.fromarray(grey), mask, LIGHT), of_color)


def test_what_is_wrong_is_said(relighter, photo_files):
    *_, pixels, mask = photo_files
    for image, coverage, says in (
        (Image.fromarray(pixels).convert("CMYK"), mask, "the image is CMYK"),
        (pixels, Image.fromarray(mask[:, 1:]), "the mask is 139x180 pixels, but the photo is 140x180"),
        (pixels, mask[1:], "the mask is 140x179 pixels, but the photo is 140x180: they must be equal"),
        (pixels, np.zeros_like(mask), "the mask is empty"),
        (pixels.astype(int), mask, "the image is int64"),
        (pixels.astype(float), mask, "the image is float64, but holds whole numbers up to"),
        (pixels[0, 0], mask, r"the image is uint8 \(3,\)"),
        (pixels[:7], mask[:7], "8 a side are the least"),
        (pixels, np.full_like(mask, 255), "covers the whole photo"),
        (pixels, pixels, "shape"),
        (pixels, mask.astype(str), r"shape \(180, 140\) of <U3: give \(height, width\) of numbers"),
        (pixels, None, "relight mask setup"),
    ):
        with pytest.raises(UserError, match=says):
            relighter.relight(image, coverage, LIGHT)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"turn": float("nan")}, "turn is nan: it must be a finite number"),
        ({"turn": "x"}, "turn is 'x'"),
        ({"size": 4}, "size is 4: it must be a finite number from 8 to "),
        ({"stops": float("nan")}, "stops is nan: it must be a finite number from -8 to 8"),
        ({"stops": 1e9}, "from -8 to 8"),
        ({"background": np.zeros((9, 9, 3), int)}, "the background is int64"),
        ({"background": "panorama", "light": "key:#ffeedd@45,30"}, "this light has no panorama"),
        ({"mode": "best"}, "neither ratio nor full"),
        ({"light": ["room:1", "other.jpg"]}, r"there is no file other\.jpg"),
        ({"light": "room:1 + auto"}, "auto is neither a file nor a light"),
    ],
)
def test_options_that_are_no_numbers_or_texts_are_refused(relighter, photo_files, options, says):
    me, mask, *_ = photo_files
    with pytest.raises(relight.UserError, match=says):
        relighter.relight(me, mask, **{"light": LIGHT, **options})
    assert {"load", "load_light", "UserError"} <= set(dir(relight))


def test_a_background_may_be_a_file_an_array_or_an_image(relighter, photo_files, tmp_path):
    me, mask, pixels, _ = photo_files
    Image.fromarray(pixels[::-1].copy()).save(tmp_path / "street.png")
    by_text = relighter.relight(me, mask, LIGHT, background=str(tmp_path / "street.png"))
    for same in (tmp_path / "street.png", pixels[::-1], Image.fromarray(pixels[::-1].copy())):
        assert np.array_equal(relighter.relight(me, mask, LIGHT, background=same), by_text)


def test_a_light_may_be_an_object_and_must_shine(relighter, photo_files):
    me, mask, *_ = photo_files
    light = load_light("room:7", order=3)
    expected = relighter.relight(me, mask, light.coefficients[:9])
    for same in (light, light.coefficients[:9].tolist(), light.coefficients[:9].T):
        np.testing.assert_array_equal(relighter.relight(me, mask, same), expected)
    room = read_light("room:7", relighter.network)
    expected = relighter.relight(me, mask, "room:7", background="panorama")
    np.testing.assert_array_equal(relighter.relight(me, mask, room, background="panorama"), expected)
    for wrong, says in (
        (Light(np.full((9, 3), np.nan), "mine"), "mine has the coefficient nan: coefficients must be finite"),
        (Light(np.zeros((9, 3)), "mine"), "mine is black"),
        ([[1, 2], [3]], "the light is not a table of real numbers"),
        (np.full((9, 3), np.nan), "the light .*finite"),
        (np.zeros((9, 3)), "the light is black"),
        (np.ones((5, 3)), r"the light has the shape \(5, 3\)"),
    ):
        with pytest.raises(UserError, match=says):
            relighter.relight(me, mask, wrong)


def test_a_light_by_name_and_as_an_object_are_one(relighter, photo_files):
    """A bare lamp is deringed either way; only coefficients are used as they are."""
    me, mask, *_ = photo_files
    lamp = "key:#ffffff@90,0,0"
    by_name = relighter.relight(me, mask, lamp)
    for light in (load_light(lamp), load_light(lamp, order=4), read_light(lamp, relighter.network)):
        np.testing.assert_array_equal(relighter.relight(me, mask, light), by_name)
    assert (relighter.relight(me, mask, load_light(lamp).coefficients) != by_name).any()
    own = read_light(str(me), relighter.network)
    for same in (own.coefficients, str(me), me, [me], Look(me, network=relighter.network).light):
        np.testing.assert_array_equal(relighter.relight(me, mask, same), relighter.relight(me, mask, own))
    both = Look(f"{me} + {lamp}", network=relighter.network).light
    np.testing.assert_allclose(both.coefficients, own.coefficients + load_light(lamp).coefficients, atol=1e-6)


def test_the_api_takes_what_the_command_takes(relighter, photo_files, run, weights, tmp_path):
    me, mask, *_ = photo_files
    words = ["--blur", 3, "--no-shadow", "--lit-by", "key:white@40,30", "--together", "--stops", 1, "-b", "panorama"]
    run("photo", me, "--light", "room:3", *words, "--weights", weights, "--out", tmp_path / "out.png")
    look = {"light": "room:3", "background": "panorama", "blur": 3, "shadow": False, "stops": 1}
    with pytest.warns(UserWarning, match="the photo's light as given"):
        relit = relighter.relight(me, mask, **look, lit_by="key:white@40,30", split=False)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "out.png")), relit)
    assert max(relighter.relight(me, mask, LIGHT, size=64).shape) == 64
    shaded = read_background("#334455")
    assert (read_background(shaded, 0, False).shadow, read_background(shaded).shadow) == (False, True)


def test_a_scene_is_inferred_once_for_many_looks(relighter, photo_files):
    me, mask, *_ = photo_files
    scene = relighter.scene(me, mask)
    for look in ({"light": LIGHT}, {"light": ["room:3", LIGHT], "turn": 30}, {"background": "#334455", "mode": "full"}):
        np.testing.assert_array_equal(scene.relit(Look(**look)), relighter.relight(me, mask, **look))
    np.testing.assert_array_equal(scene.relit(Look(["room:3", LIGHT])), scene.relit(Look(f"room:3 + {LIGHT}")))
    np.testing.assert_array_equal(scene.relit(Look(scene.light)), scene.picture.pixels)


def test_notes_are_warnings(relighter, photo_files):
    me, _, pixels, mask = photo_files
    cut = np.roll(mask, np.flatnonzero(mask.any(1))[0] * -1 - 5, 0)
    cut[-5:] = 0  # the head is cut off
    holed, impossible = mask / 255, np.zeros((9, 3))
    holed[0, 0], impossible[0], impossible[2] = np.nan, 1, 3
    for use, given, says in (
        (relighter.infer, (pixels, cut), "image: the figure is cut by the photo's upper edge"),
        (relighter.relight, (pixels, cut, LIGHT), "image: the figure is cut by the photo's upper edge"),
        (relighter.infer, (pixels, holed), "image: the mask has 1 values that are not numbers"),
        (relighter.relight, (me, mask, impossible), "the light: no real light has these coefficients"),
    ):
        with pytest.warns(UserWarning, match=f"^{says}"):
            use(*given)


def test_white_balance(relighter, photo_files):
    """By default the light of a photo is white on the mean; `scene` gives what the network says; no third way."""
    me, *_ = photo_files
    (kept,), (raw,) = (relighter.infer(me, white_balance=way) for way in ("keep", "scene"))
    assert np.ptp(kept.shading[kept.mask].mean(0)) < 1e-5 < np.ptp(raw.shading[raw.mask].mean(0))
    assert np.allclose(kept.light * kept.white, raw.light) and (raw.white == 1).all()
    assert np.array_equal(read_light(str(me), relighter.network).coefficients, kept.light)
    assert (relighter.relight(me, None, LIGHT) != relighter.relight(me, None, LIGHT, white_balance="scene")).any()
    with pytest.raises(UserError, match="'auto' is neither keep nor scene"):
        relighter.infer(me, white_balance="auto")


@pytest.mark.slow
def test_a_known_light_takes_the_place_of_the_inferred_one(relighter, photo_files):
    """In its exposure, and with the same product of albedo and shading; its own picture comes back."""
    me = photo_files[0]
    inferred = relighter.scene(me, white_balance="scene")
    scene = relighter.scene(me, white_balance="scene", lit_by="key:#ffffff@40,30,0.4")
    (before,), (person,) = inferred.people, scene.people
    lamp = deringed(load_light("key:#ffffff@40,30,0.4").coefficients)
    np.testing.assert_allclose(person.light / person.light[0, 0], lamp / lamp[0, 0], rtol=1e-4, atol=1e-5)
    shades = [luminance(each.shading)[each.mask].mean() for each in (before, person)]
    assert shades[0] == pytest.approx(shades[1], rel=1e-4)
    bright = person.mask & (before.shading.min(-1) > 0.3) & (person.shading.min(-1) > 0.3) & (person.albedo.max(-1) < 1)
    np.testing.assert_allclose(*[(each.albedo * each.shading)[bright] for each in (before, person)], rtol=0.02)
    assert re.match(r"the photo's light as given, key:#ffffff@40,30,0\.4, is \d+ degrees from", scene.notes[0])
    assert not any("degrees" in note for note in relighter.scene(me, lit_by="even").notes)
    lamps = [load_light(f"key:#ffffff@{azimuth},0,0").coefficients for azimuth in (0, 25, 180)]
    assert [round(degrees_apart(lamps[0], lamp)) for lamp in lamps] == [0, 25, 180]
    with pytest.raises(UserError, match="lit by auto: name the light"):
        relighter.scene(me, lit_by="auto")
    impossible = Light(np.eye(9, 3) * [1, 5, 5], "impossible").checked()
    assert relighter.scene(me, lit_by=impossible).notes.count(impossible.notes[0]) == 1
    for wrong, says in ((0, "x is black"), (np.nan, "coefficients must be finite")):
        with pytest.raises(UserError, match=says):
            relighter.scene(me, lit_by=Light(np.full((9, 3), wrong), "x"))
    again = scene.relit(Look(Light(person.light, "its own"), match=False))
    assert np.abs(again.astype(int) - inferred.picture.pixels).max() <= 1


@pytest.mark.slow
def test_a_light_from_behind_is_told_with_the_turn_that_mends_it(relighter, photo_files):
    scene = relighter.scene(photo_files[0])
    behind, below = (scene.notes_on(Look(f"key:#ffffff@{place}")) for place in ("-150,10", "0,-70,0.1"))
    assert behind == ["most of this light comes from behind: faces suffer; a turn of 150 brings it to the front"]
    assert len(below) == 1 and below[0].startswith("most of this light comes from below")
    for light, turn in (("key:#ffffff@-150,10", 150.0), ("key:#ffffff@80,10", 0.0), ("even", 180.0)):
        assert scene.notes_on(Look(light, turn=turn)) == []
