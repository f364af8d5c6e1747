import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from relight import load_light
from relight.core.errors import UserError
from relight.lights.light import direction
from relight.lights.place import place_light
from relight.sh import deringed, rotate_y
from relight.viewer.source import named_lights


@pytest.fixture
def street(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pixels = np.tile(np.linspace(20, 240, 80).astype(np.uint8)[None, :, None], (60, 1, 3))
    pixels[..., 2] //= 2
    Image.fromarray(pixels).save("street.png")
    return pixels


def test_load_light_reads_places(street):
    plain = place_light(street)
    light = load_light("place:street.png")
    np.testing.assert_array_equal(light.coefficients, plain)
    assert light.source == "place:street.png" and "estimated from street.png" in light.notes[0]
    for name, toward in {"@-60,40": (-60, 40), "@90": (90, 45), "@+10.5,-20": (10.5, -20)}.items():
        light = load_light(f"place:street.png{name}")
        np.testing.assert_allclose(light.coefficients, place_light(street, direction(*toward, "")))
        assert not light.notes
    turned = load_light("place:street.png", order=3, yaw=30)
    assert len(turned.coefficients) == 16
    np.testing.assert_allclose(turned.coefficients[:9], rotate_y(plain, np.radians(30)))
    np.testing.assert_allclose(load_light("place:street.png", flip=True).coefficients[3], -plain[3])
    Image.fromarray(street).save("a@7.png")
    np.testing.assert_array_equal(load_light("place:a@7.png").coefficients, plain)


def test_load_light_reads_places_in_a_new_process(street):
    """Where no package that knows pictures is imported yet."""
    program = "import relight; print(relight.lights.load_light('place:street.png').coefficients[0, 0])"
    words = [sys.executable, "-c", f"import relight.lights; {program}"]
    said = subprocess.run(words, capture_output=True, text=True, check=True)
    assert float(said.stdout) == pytest.approx(place_light(street)[0, 0])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("place:none.png", r"^place: there is no file none\.png"),
        ("place:kitchen.hdr", r"^place:kitchen\.hdr: kitchen\.hdr is no photograph of a place: give a JPEG"),
        ("place:street.png@0,91", r"^place:street\.png@0,91: elevation is '91': it must be"),
        ("place:street.png@1-2", "azimuth is '1-2'"),
        ("place:", "no photograph"),
        ("street.png", "is a photo, .*: place:street.png estimates its light"),
    ],
)
def test_load_light_refuses_what_names_no_place(street, name, message):
    with pytest.raises(UserError, match=message):
        load_light(name)


@pytest.mark.slow
def test_photo_takes_the_light_of_a_picture_behind(run, photo_files, weights, street, tmp_path):
    me = photo_files[0]
    options = ("photo", me, "-w", weights, "--out", "out", "--background", "street.png")
    said = run(*options)
    assert "me.png in the light of place:street.png" in said and "note: the light is estimated from street.png" in said
    assert json.loads((tmp_path / "out" / "photo.json").read_text())["light"] == "place:street.png"
    light = load_light(tmp_path / "out" / "new_light.json").coefficients
    expected = deringed(place_light(street))
    np.testing.assert_allclose(light / light[0, 0], expected / expected[0, 0], rtol=1e-4, atol=1e-5)
    assert "in the light of room:3" in run(*options, "--light", "room:3")
    assert "estimated" not in run(*options, "--light", "place:street.png@-60,40")
    assert "in the light of key:" in run("photo", me, "-w", weights, "--out", "out")


def test_light_command_of_a_photo(run, street):
    assert "place:street.png, convention relight" in run("light", "street.png", "-o", "a.json")
    Image.fromarray(street).save("a@7.png")
    for name in ("a@7.png", "a@7.png@-60,40", "street.png + key:red@9"):
        assert f"place:{name}, convention" in run("light", name)
    np.testing.assert_allclose(load_light("a.json").coefficients, place_light(street))
    for words in (["--order", 2, "street.png@-60,40"], ["place:street.png@-60,40", "--yaw", 0]):
        run("light", *words, "-o", "b.json")
        np.testing.assert_allclose(load_light("b.json").coefficients, place_light(street, direction(-60, 40, "")))
    run("light", "place:street.png", "-o", "ball.png")
    assert Image.open("ball.png").size
    assert "place:street.png" in named_lights(["place:street.png"])
