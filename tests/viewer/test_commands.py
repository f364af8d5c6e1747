import json
import re

import numpy as np
import pytest
from PIL import Image
from samples import photo_of_people
from typer.testing import CliRunner

from relight.core.errors import UserError
from relight.lights import load_light, write_light
from relight.maps import write_left_out, write_maps
from relight.photos.api import load
from relight.photos.render import total_coverage
from relight.sh import irradiance
from relight.viewer.commands import app, web_app
from relight.viewer.source import LIGHTS, baked_figure, named_lights


def embedded(path):
    text = path.read_text()
    page = json.loads(re.search(r'id="page">(.*?)</script>', text, re.S)[1])
    return page, [json.loads(f) for f in re.findall(r'class="figure"[^>]*>(.*?)</script>', text, re.S)]


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)


def test_view_writes_a_page_for_baked_maps(tmp_path, maps):
    maps.info.update(name="balls", order=2)
    write_maps(tmp_path / "b.exr", maps)
    result = run(tmp_path / "b.exr", tmp_path / "b.exr")
    assert result.exit_code == 0 and "b.html" in result.output and "MB" in result.output
    page, figures = embedded(tmp_path / "b.html")
    assert page["title"] == "balls" and [light["name"] for light in page["lights"]] == list(LIGHTS)
    assert [figure["title"] for figure in figures] == ["balls", "balls"]
    assert not any("light" in figure for figure in figures)
    run(tmp_path / "b.exr", "-l", "key:#ffffff@0,0", "-l", "room:2", "-o", tmp_path / "c.html", "-b", "light")
    page, _ = embedded(tmp_path / "c.html")
    assert [light["name"] for light in page["lights"]] == ["key:#ffffff@0,0", "room:2"]
    assert page["background"] == "light"


def test_lights_are_brought_to_one_brightness(tmp_path):
    lights = [*named_lights().values()]
    assert irradiance(lights[0], np.array([0, 0, 1.0])).max() == pytest.approx(0.8)
    means = [np.maximum(light[0], 0) for light in lights]
    brightness = [max(mean @ [0.2126, 0.7152, 0.0722], 0.6 * mean.max()) for mean in means]
    np.testing.assert_allclose(brightness, brightness[0])
    for names, expected in ((("#ffffff", "#ff0000"), (0.8, 0.8 / 0.6)), (("#ff0000", "#ffffff"), (0.8, 0.8 * 0.6))):
        pair = named_lights(f"key:{color}@0,0,0" for color in names).values()
        toward = [irradiance(light, np.array([0, 0, 1.0])).max() for light in pair]
        np.testing.assert_allclose(toward, expected, err_msg="as the page scales a light of one's own")
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_light(load_light("room:7"), tmp_path / folder / "hall.json")
    names = [str(tmp_path / folder / "hall.json") for folder in ("a", "b")]
    assert list(named_lights(names)) == names and list(named_lights(names[:1])) == ["hall"]
    behind, even = named_lights(["key:#ffffff@180,0,0", "even"]).values()
    assert irradiance(behind, np.array([0, 0, -1.0])).max() < 4
    np.testing.assert_allclose(irradiance(even, np.array([0, 0, 1.0])), 0.8)
    with pytest.raises(UserError, match="black"):
        named_lights(["key:#000000@0,0"])


def test_wrong_input_is_told_in_a_sentence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_left_out(tmp_path / "left.exr", {"name": "x"}, "no faces")
    with pytest.raises(UserError, match="left out: no faces"):
        baked_figure(tmp_path / "left.exr")
    for words, says in (
        (["scan.obj"], r"scan\.obj is no photo and no maps: `relight bake`"),
        (["none.exr"], "no file"),
        (["."], r"there is no file \."),
        (["left.exr", "--mask", "m.png"], "--mask belongs to one photo"),
        (["left.exr", "-o", "left.exr"], r"must end in \.html"),
        (["left.exr", "-o", "nosuch/dir/x.html"], "there is no folder .*nosuch"),
    ):
        with pytest.raises(UserError, match=says):
            run(*words)
    assert [path.name for path in tmp_path.iterdir()] == ["left.exr"]


@pytest.mark.slow
def test_a_photo_of_two_people_is_shown_as_the_photo_command_shows_it(page, tmp_path, monkeypatch, weights, maps):
    monkeypatch.chdir(tmp_path)
    relighter = load(weights, threads=1)
    config = relighter.network.config
    monkeypatch.setattr("relight.photos.api.load", lambda weights: relighter)
    pixels, mask = photo_of_people(90, 140, (38, 100))
    Image.fromarray(pixels).save(tmp_path / "me.png")
    Image.fromarray(mask).save(tmp_path / "me_mask.png")
    assert run(tmp_path / "me.png", "-l", "room:3").exit_code == 0
    page.open(tmp_path / "me.html")
    state = {"light": 0, "background": "photo", "mode": "ratio", "yaw": 0, "tilt": 0, "stops": 0, "view": "relit"}
    np.testing.assert_array_equal(page.pixels(**state)[..., :3], pixels)
    own = np.array(page.run("[...relight.lights()[0].values]")).reshape(9, 3)
    assert page.run("relight.lights().map((light) => light.name)") == ["As taken", "room:3"]
    figures = relighter.infer(pixels, mask)
    assert len(figures) == 2
    shown = page.pixels(**state | {"mode": "full", "stops": 1})[..., :3].astype(int)
    expected = relighter.relight(pixels, mask, own, "full", match=False, stops=1).astype(int)
    cover = total_coverage(figures)
    assert np.abs(shown - expected)[cover == 255].max() <= 2
    np.testing.assert_array_equal(shown[cover == 0], pixels[cover == 0])
    monkeypatch.setitem(config["train"], "color", "paper")
    write_maps(tmp_path / "b.exr", maps)
    for words in (["me.png"], ["build", "site", "b.exr"]):
        with pytest.raises(UserError, match="color=photo"):
            CliRunner().invoke(web_app if len(words) > 1 else app, words, catch_exceptions=False)
    monkeypatch.setitem(config["train"], "color", "photo")
    monkeypatch.setitem(config["model"], "order", 1)
    with pytest.raises(UserError, match=r"order 2; .* has order 1"):
        CliRunner().invoke(web_app, ["build", "site", "b.exr"], catch_exceptions=False)
    monkeypatch.setitem(config["model"], "order", 2)
    assert run(tmp_path / "me.png", "--size", 70, "-o", tmp_path / "small.html").exit_code == 0
    assert embedded(tmp_path / "small.html")[1][0]["width"] == 70
