import io
import json
import re
from unittest.mock import Mock

import numpy as np
import pytest
from samples import write_exr
from typer.testing import CliRunner

from relight.core.errors import UserError
from relight.lights import Light, load_light, reference_brightness, write_light
from relight.lights.commands import app
from relight.panoramas import generate_room, orient, project
from relight.photos.look import Look
from relight.sh import irradiance


@pytest.mark.parametrize("text", ["a.exr", "room:7:40", "sky:3"])
@pytest.mark.parametrize("yaw, flip", [(0, False), (70, False), (0, True), (-25, True)])
def test_panorama_and_coefficients_are_oriented_alike(tmp_path, monkeypatch, text, yaw, flip):
    monkeypatch.chdir(tmp_path)
    write_exr(tmp_path / "a.exr", np.random.default_rng(0).random((16, 32, 3)).astype(np.float32))
    light, plain = load_light(text, yaw=yaw, flip=flip), load_light(text.removesuffix(":40"))
    np.testing.assert_allclose(project(light.panorama), light.coefficients, rtol=1e-5)  # its pixels are float32
    turned = orient(plain.coefficients, yaw + 40 * text.endswith(":40"), flip)
    np.testing.assert_allclose(light.coefficients, turned, rtol=1e-12)


def test_a_panorama_that_is_brighter_from_below_gets_a_note(tmp_path):
    wrong = write_exr(tmp_path / "b.exr", generate_room(7)[::-1])
    (note,) = load_light(wrong).notes
    assert note.startswith(f"{wrong}: brighter from below") and note in CliRunner().invoke(app, [str(wrong)]).output
    for pixels in (generate_room(7), np.ones((8, 16, 3), np.float32)):
        assert not load_light(write_exr(tmp_path / "a.exr", pixels)).notes


def test_a_key_light_comes_from_the_given_direction_and_even_light_from_all():
    light = load_light("key:#ff8000@90,0,0")
    e = irradiance(light.coefficients, np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    np.testing.assert_allclose(e[0], 1.0625 * np.array([1, 0.2158605, 0]), atol=1e-6)
    assert e[0, 0] > 4 * e[1:, 0].max()
    assert irradiance(load_light("key:ffffff@0,90,0.3").coefficients, [0, 1, 0])[0] == pytest.approx(1.3625)
    np.testing.assert_allclose(irradiance(load_light("even", 3).coefficients, np.eye(3) * [1, -1, 1]), 1, atol=1e-12)
    for same in ("key:#f00@45,30", "key:red@45,30"):
        np.testing.assert_array_equal(load_light(same).coefficients, load_light("key:#ff0000@45,30").coefficients)


def test_lights_add_up(tmp_path):
    parts = "room:7", "key:#ffeedd@45,30", "sky:2"
    apart = [load_light(part, 3, yaw=20.0, flip=True) for part in parts]
    both = load_light(f"{parts[0]} + {parts[1]}", 3, yaw=20.0, flip=True)
    np.testing.assert_allclose(both.coefficients, apart[0].coefficients + apart[1].coefficients)
    np.testing.assert_array_equal(both.panorama.pixels, apart[0].panorama.pixels)
    assert load_light(" + ".join(parts)).panorama is None, "neither of two shows the whole light"
    with pytest.raises(UserError, match=r"^key:#ff@1,2: '#ff' is no color"):
        load_light("room:7 + key:#ff@1,2")
    many = " + ".join(30 * [parts[1]])  # longer than the name of a file can be
    np.testing.assert_allclose(load_light(many).coefficients, 30 * load_light(parts[1]).coefficients)
    file = tmp_path / "a + b.json"
    write_light(apart[1], file)
    np.testing.assert_array_equal(load_light(file, 3).coefficients, apart[1].coefficients)


@pytest.mark.parametrize("suffix", [".json", ".npy"])
@pytest.mark.parametrize("convention", ["relight", "kanamori2018", "ramamoorthi2001", "dpr", "irradiance"])
def test_written_lights_name_their_convention_and_can_be_read_back(tmp_path, suffix, convention):
    light = load_light("room:3")
    path = write_light(light, tmp_path / f"my{suffix}", convention)
    assert convention in (path.read_text() if suffix == ".json" else path.name)
    for name in (path.name, path.name.upper()):
        path = path.rename(tmp_path / name)
        np.testing.assert_allclose(load_light(path).coefficients, light.coefficients, rtol=1e-12, atol=1e-12)


def test_files_of_coefficients(tmp_path):
    light = load_light("room:3").coefficients
    np.savetxt(tmp_path / "a.txt", light, header="nine rows")
    np.savetxt(tmp_path / "b.csv", light.T, delimiter=",")
    (tmp_path / "c.json").write_text(json.dumps(light.ravel().tolist()))
    probe = {"type": "LightProbe", "sh": light.ravel().tolist(), "intensity": 2}
    (tmp_path / "d.json").write_text(json.dumps({"object": probe}))
    for name, factor in (("a.txt", 1), ("b.csv", 1), ("c.json", 1), ("d.json", 2)):
        np.testing.assert_allclose(load_light(tmp_path / name).coefficients, factor * light, rtol=1e-12)
    np.save(tmp_path / "grey.npy", light[:, 0])
    np.testing.assert_allclose(load_light(tmp_path / "grey.npy", convention="relight").coefficients[:, 2], light[:, 0])
    np.testing.assert_allclose(load_light(tmp_path / "a.txt", order=3).coefficients[9:], 0)
    assert load_light(tmp_path / "a.txt", order=1).coefficients.shape == (4, 3)


def test_options_without_an_effect_or_of_the_wrong_kind_are_refused(tmp_path):
    panorama = write_exr(tmp_path / "a.exr", np.ones((8, 16, 3), np.float32))
    np.savetxt(tmp_path / "a.txt", np.eye(9, 3))
    for text, options, says in (
        ("room:7", {"layout": "strip"}, "layout has an effect on a file of a panorama only"),
        ("key:#ffffff@0,0", {"convention": "dpr"}, "convention has an effect on a file of coefficients only"),
        (panorama, {"convention": "dpr"}, "convention has an effect"),
        (panorama, {"layout": "foo"}, "layout=foo"),
        (tmp_path / "a.txt", {"repair": True}, "repair has an effect on a file of a panorama only"),
        ("room:7", {"order": -1}, "order=.*must be"),
        ("room:7", {"order": 2.0}, "order=.*must be"),
        ("room:7", {"yaw": "x"}, "yaw is 'x': it must be a finite number"),
        ("room:7", {"yaw": np.inf}, "yaw is inf"),
    ):
        with pytest.raises(UserError, match=says):
            load_light(text, **options)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e31])
def test_lights_beyond_single_precision_are_refused(value):
    light = Light(np.full((9, 3), value), "mine")
    for use in (light.checked, light.normalised, lambda: Look(light)):
        with pytest.raises(UserError, match=r"mine has the coefficient .*finite numbers, at most 1e"):
            use()


def test_impossible_lights_and_conventions_other_than_the_file_s_get_a_note(tmp_path):
    path = write_light(load_light("room:3"), tmp_path / "a.json", "dpr")
    assert not load_light(path).notes and not load_light(path, convention="dpr").notes
    note = f"{path} says that its convention is dpr; it is read as relight"
    assert note in load_light(path, convention="relight").notes
    sharp = load_light("key:ffffff@0,30,0").coefficients * np.repeat([1, 1.5, 2.5], [1, 3, 5])[:, None]
    np.save(tmp_path / "a.npy", sharp)
    (note,) = load_light(tmp_path / "a.npy").checked().notes
    assert "no real light" in note
    for lamp in ("key:#ff0000@45,30", "key:#00ffff@45,30,0"):  # channels that are black are real
        assert load_light(lamp).notes == []


def npy(values) -> bytes:
    file = io.BytesIO()
    np.save(file, values, allow_pickle=True)
    return file.getvalue()


WRONG = {
    "black.npy": npy(np.zeros((9, 3))), "pickle.npy": npy(np.array([{"a": 1}], dtype=object)),
    "a.npy": b"\x93NUMPY nothing", "a.txt": b"one two three", "a.json": b'{"light": 3}', "b.json": b"{",
    "c.json": b'{"coefficients": [1, 2]}', "d.json": b'{"coefficients": [], "convention": "x"}',
    "a.csv": b"1,2\n", "b.txt": b"\xff\xfe\x00", "e.json": b"[" * 100000, "c.txt": b"1 2 3\n1 2\n",
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_broken_files_are_named(tmp_path, name):
    (tmp_path / name).write_bytes(WRONG[name])
    with pytest.raises(UserError, match=re.escape(name)):
        load_light(tmp_path / name)


@pytest.mark.parametrize(
    "text", ["room:", "room:x", "room:-1", "nowhere.hdr", "a.npz", "", ".", 300 * "x", 300 * "x" + ".hdr"]
)
def test_invalid_names_of_lights_are_refused(text):
    with pytest.raises(UserError):
        load_light(text)


def test_normalised_scales_the_front_to_the_target_and_limits_back_lit_lights():
    light = load_light("room:7").normalised(0.8)
    assert float(reference_brightness(light.coefficients)) == pytest.approx(0.8)
    np.testing.assert_allclose(project(light.panorama), light.coefficients, atol=1e-5)
    assert irradiance(load_light("key:ffffff@180,0,0.01").normalised(0.8).coefficients, np.eye(3)).max() < 4
    with pytest.raises(UserError, match="is black"):
        Light(np.zeros((9, 3)), "nothing").normalised()
    for target in (-1, 0, np.nan, np.inf, 1e300):
        with pytest.raises(UserError, match="must be a finite number from 1e-12 to 1e"):
            light.normalised(target)


def test_the_command_prints_lights_of_every_size_writes_and_draws(tmp_path, monkeypatch):
    run = CliRunner().invoke
    out = ["--out", str(tmp_path / "a.json"), "-o", str(tmp_path / "a.npy")]
    done = run(app, ["room:12", *out, "--to", "kanamori2018"])
    assert done.exit_code == 0, done.output
    assert re.search(r"B\s.*G\s.*R\s", done.output), "kanamori2018 has blue first"
    for name in ("a.kanamori2018.npy", "a.json"):
        np.testing.assert_allclose(load_light(tmp_path / name).coefficients, load_light("room:12").coefficients)
    assert "reference brightness" in done.output and len(re.findall(r"-?\d\.\d{6}", done.output)) == 27
    monkeypatch.setattr("rich.console.Console.print", Mock(side_effect=BrokenPipeError))
    run(app, ["room:12", "--out", str(tmp_path / "piped.json")])
    assert (tmp_path / "piped.json").exists()  # although `| head` closed the pipe
    monkeypatch.undo()
    done = run(app, ["room:12", "-o", str(tmp_path / "b.png"), "--order", "3", "--to", "unity"])
    assert "needs 9" in str(done.exception) and not (tmp_path / "b.png").exists()
    assert isinstance(run(app, ["nowhere.hdr"]).exception, UserError)
    for wrong, why in (("a.jpg", "and drawn as .png"), ("a.dpr.npy", "its name says dpr")):
        done = run(app, ["even", *(f"--out={tmp_path / name}" for name in ("first.png", "first.json", wrong))])
        assert why in str(done.exception) and not [*tmp_path.glob("first.*")], "nothing is written"
    assert run(app, ["--help"]).exit_code == 0
    for scale in (1, 1e-6):
        np.savetxt(tmp_path / "a.txt", scale * np.eye(9, 3))
        shown = re.search(r"0, 0 \D*([-.e\d]+)", run(app, [str(tmp_path / "a.txt")]).output)[1]
        assert float(shown) == pytest.approx(scale, rel=1e-6)


ROWS = [[round(0.5 - 0.1 * row + 0.2 * column, 2) for column in range(3)] for row in range(9)]
TABLES = {
    "blanks": "\n".join(" ".join(map(str, row)) for row in ROWS).encode(),
    "a mark and CR LF": ("\ufeff" + "\r\n".join(",".join(map(str, row)) for row in ROWS)).encode(),
    "utf-16": "\n".join("\t".join(map(str, row)) for row in ROWS).encode("utf-16"),
    "decimal commas": "\n".join(";".join(map(str, row)).replace(".", ",") for row in ROWS).encode(),
    "quotes": "\n".join(",".join(f'"{value}"' for value in row) for row in ROWS).encode(),
    "comments in Latin-1": b"# \xe9clair\n" + "\n".join(" ".join(map(str, row)) for row in ROWS).encode(),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_load_light_reads_tables_of_every_spelling(tmp_path, name):
    (tmp_path / "a.csv").write_bytes(TABLES[name])
    np.testing.assert_allclose(load_light(tmp_path / "a.csv").coefficients, ROWS)


KEYS = {
    "key:rad@0,0": "'rad' is no color: give #ffeedd, or a name such as red",
    "key:#ff@45,30": "'#ff' is no color",
    "key:#ffd9@70,20": "'#ffd9' is no color",  # nor a color with alpha
    "key:": "'' is no color",
    "key:hsl(30,501%,40%)@1,2": "is no color",
    "key:#ffffff@45,30,1,2": "after the @ come azimuth",
    "key:#ffffff@a,b": "azimuth is 'a': it must be a finite number from -360 to 360",
    "key:#ffffff@400,30": "azimuth is '400'",
    "key:#ffffff@0,95": "elevation is '95': it must be a finite number from -90 to 90",
    "key:#ffffff@0,0,-1": "fill is '-1': it must be a finite number from 0 to 1e+06",
    "key:#ffffff@0,0,1e308": "fill is '1e308'",
    "key:#ffffff@0,0,inf": "fill is 'inf'",
    "key:#ffffff@nan,0": "azimuth is 'nan'",
    "key:#000000@0,0": "key:#000000@0,0 is black",
}


@pytest.mark.parametrize("text", KEYS)
def test_load_light_says_what_is_wrong_with_a_lamp(text):
    with pytest.raises(UserError, match=re.escape(KEYS[text])):
        load_light(text)
