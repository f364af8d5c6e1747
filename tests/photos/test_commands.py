import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from typer.main import get_command
from typer.testing import CliRunner

from relight.cli import app
from relight.core.errors import UserError
from relight.lights import load_light
from relight.photos.api import load
from relight.photos.commands import relit
from relight.photos.folder import MOST_LINES, _fingerprint, note_lines
from relight.photos.look import Look


def picture(path):
    return np.asarray(Image.open(path))


def test_photo_writes_everything_at_its_place(run, photo_files, weights, tmp_path):
    me, _, pixels, mask = photo_files  # me_mask.png lies beside me.png and is found
    out = tmp_path / "out"
    run("photo", me, "--light", "room:3:40", "--out", out, "--weights", weights)
    assert not (out / "maps.exr").exists() and not (out / "albedo.png").exists()
    assert "relit.png" in run("photo", me, "--light", "room:3:40", "--out", out, "--weights", weights, "--maps")
    relit = picture(out / "relit.png")
    assert relit.shape == pixels.shape and np.array_equal(relit[mask == 0], pixels[mask == 0])
    assert (relit[mask == 255] != pixels[mask == 255]).any()
    for name in ("albedo.png", "shading.png"):
        assert np.array_equal(picture(out / name)[..., 3], mask)
    light = load_light(str(out / "light.json"))
    assert light.coefficients.shape == (9, 3) and light.coefficients[0].min() > 0
    assert json.loads((out / "light.json").read_text())["convention"] == "relight"
    assert picture(out / "light.png").shape == (256, 256, 4)
    new, room = (load_light(name).coefficients[0].argmax() for name in (out / "new_light.json", "room:3"))
    assert new == room
    record = json.loads((out / "photo.json").read_text())
    assert record["size"] == [140, 180] and record["people"][0]["error"] > 0
    exr = OpenEXR.File(str(out / "maps.exr"), separate_channels=True)
    header, channels = exr.header(), exr.channels()
    assert tuple(header["displayWindow"][1]) == (139, 179)
    left, top = header["dataWindow"][0]
    coverage, part = np.zeros(mask.shape, np.float32), channels["coverage.A"].pixels
    coverage[top : top + part.shape[0], left : left + part.shape[1]] = part
    assert np.abs(coverage * 255 - mask).max() < 0.1
    names = {f"transport.{n}.Y" for n in "L0M0 L1Mn1 L1M0 L1M1 L2Mn2 L2Mn1 L2M0 L2M1 L2M2".split()}
    assert names <= set(channels) and channels["albedo.R"].pixels.max() <= 1.01
    transport = np.stack([channels[f"transport.{n}.Y"].pixels for n in ("L0M0", "L1Mn1", "L1M0", "L1M1")], -1)
    assert transport.dtype == np.float16 and np.isfinite(transport).all()
    normal = np.stack([channels[f"normal.{axis}"].pixels for axis in "XYZ"], -1).astype(float)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), part > 0, atol=2e-3)
    linear = transport[..., [3, 1, 2]].astype(float)
    np.testing.assert_allclose(normal * np.linalg.norm(linear, axis=-1, keepdims=True), linear, atol=2e-3)
    assert not [*out.glob(".*")]


def test_own_light_from_disk_or_of_the_photo_itself_returns_the_photo(run, photo_files, weights, tmp_path):
    """Results that are given are not overwritten."""
    me, mask, pixels, _ = photo_files
    run("photo", me, "--out", tmp_path / "a", "--weights", weights)
    for light in (tmp_path / "a/light.json", me):
        run("photo", me, "--light", light, "--out", tmp_path / "b", "--weights", weights)
        assert np.abs(picture(tmp_path / "b/relit.png").astype(int) - pixels).max() <= 1
    out = tmp_path / "a"
    before = {path: path.read_bytes() for path in out.iterdir()}
    for words in ([me, "--light", out / "new_light.json"], [out / "relit.png", "--mask", mask]):
        with pytest.raises(UserError, match="would be overwritten: give another --out"):
            run("photo", *words, "--out", out, "--weights", weights)
    assert before == {path: path.read_bytes() for path in out.iterdir()}


def test_doubts_about_a_mask_are_said_wherever_one_is_used(run, photo_files, weights, tmp_path):
    me, mask, *_ = photo_files
    folder, inverted = tmp_path / "in", tmp_path / "in" / "you_mask.png"
    folder.mkdir()
    shutil.copy(me, folder / "you.png")
    Image.fromarray(255 - np.asarray(Image.open(mask).convert("L"))).save(inverted)
    doubt = "the mask may be inverted"
    two = run("photo", me, "-m", mask, "-l", "room:3", "-l", "key:#ffffff@9,9", "-o", tmp_path / "two", "-w", weights)
    assert "in the light of room:3 + key:#ffffff@9,9" in two
    lit = ["photo", me, "-m", mask, "-l", folder / "you.png", "--out", tmp_path / "lit", "--weights", weights]
    assert f"note: you.png: {doubt}" in run(*lit)
    assert doubt in (tmp_path / "lit" / "photo.json").read_text()
    Image.new("RGB", (9, 9)).save(folder / "other_mask.png")
    (folder / "below").mkdir()
    (folder / "notes.txt").touch()
    summary = run("photo", folder, "--out", tmp_path / "out", "--weights", weights)
    assert f"note: you.png: {doubt}" in summary
    assert "are relit: folders: 1, masks without a photo: 1, files of other kinds: 1\n" in summary
    assert f"note: you: {doubt}" in run("view", folder / "you.png", "--out", tmp_path / "a.html", "--weights", weights)
    with pytest.raises(UserError, match=r"holds no photo \(\.jpg, .*\.exr\)"):
        run("photo", tmp_path / "out", "--out", tmp_path / "none")  # with folders, which are not searched


def test_the_table_of_options_is_whole():
    page = (Path(__file__).parents[2] / "docs" / "photos.md").read_text(encoding="utf-8")
    table = page.split("### All options")[1].split("\n## ")[0]
    listed = {flag for line in table.splitlines() for flag in re.findall(r"`(--[a-z-]+)`", line.split(" | ")[0])}
    commands = get_command(app).commands
    options = [option for name in ("photo", "movie") for option in commands[name].params]
    known = {flag for option in options for flag in (*option.opts, *option.secondary_opts) if flag.startswith("--")}
    assert listed == known - {"--help"}


def test_many_notes_on_a_folder_are_counted():
    lines = note_lines({f"{n}.png": ["automatic", f"note {n}"] for n in range(20)})
    assert lines[:2] == ["note: 20 photos: automatic", "note: 0.png: note 0"]
    assert len(lines) == MOST_LINES + 1 and lines[-1] == "note: 9 more are in photo.json of the photos"


def bad(tmp_path, weights):
    (tmp_path / "light.hdr").write_text("no light")
    (tmp_path / "old.pt").write_bytes(b"\x80\x04pickle")
    (tmp_path / "mine.safetensors").touch()
    me = tmp_path / "me.png"
    yield [tmp_path / "none.jpg"], "no file or folder"
    yield [me, "--mask", tmp_path / "none.png"], "no file"
    yield [me, "--light", tmp_path / "light.hdr"], "light.hdr"
    yield [me, "--light", "room:x"], "room:x"
    yield [me, "--background", "nothing such"], "background .* is not keep"
    yield [me, "--weights", tmp_path / "old.pt"], "no network of relight"
    yield [me, "--weights", tmp_path / "mine.safetensors"], "`relight export mine.safetensors mine.onnx` writes"
    yield [me, "--out", me], "would be overwritten"
    yield [me, "--out", tmp_path / "me_mask.png"], "me_mask.png would be overwritten"
    mask = tmp_path / "me_mask.png"
    for flag, name in (("--light", f"place:{mask}@30"), ("--lit-by", f"even + place:{mask}"), ("--background", mask)):
        yield [me, flag, name, "--mask", me, "--out", mask], "me_mask.png would be overwritten"
    yield [me, "--maps", "--out", "one.png"], "--maps writes several files, and --out one.png is one picture"
    yield [me, "--background", "transparent", "--out", "one.jpg"], "a JPEG cannot be transparent"
    yield [me, "--background", "#00000000"], "background #00000000 is not opaque: give a color without alpha"
    Image.new("RGB", (65501, 8)).save(wide := tmp_path / "wide.png")
    yield [wide, "--mask", mask, "--out", "one.jpg"], r"at most 65500 pixels a side; end it in \.png"
    yield [me, "--out", me / "sub"], "nothing can be written there"
    yield [me, me, "--out", "two.png"], "two.png is one picture, and there are several photos: give a folder"
    yield [me, "--out", "out.mp4"], r"\.mp4 is not written; end it in \.jpg or \.png, or give a folder"
    yield [me, "--background", tmp_path / "none.png"], r"background: there is no file .*none\.png"
    yield [me, "--blur", "3"], "a panorama or a picture behind can be blurred, not the background keep"
    yield [me, "--mask", me], "is the photo itself"


@pytest.mark.slow
def test_bad_input_is_one_line_and_overwrites_nothing(run, photo_files, weights, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "relit.png").write_bytes(b"precious")
    for words, says in bad(tmp_path, weights):
        words = [*words] if "--weights" in words else [*words, "--weights", weights]
        words = words if "--out" in words else [*words, "--out", out]
        with pytest.raises(UserError, match=says) as error:
            run("photo", *words)
        assert "\n" not in str(error.value)
    assert [p.name for p in out.iterdir()] == ["relit.png"] and (out / "relit.png").read_bytes() == b"precious"


@pytest.mark.parametrize("name", ["m.jpg", "m.webp", "m", "m.TIF"])
def test_a_mask_is_drawn_as_png(run, photo_files, tmp_path, name):
    with pytest.raises(UserError, match=rf"--out .*{name}: a mask is a \.png"):
        run("mask", "draw", photo_files[0], "--out", tmp_path / name)


@pytest.mark.slow
def test_a_folder_goes_on_after_failures_and_resumes(run, weights, tmp_path, draw, monkeypatch):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    for i in range(3):
        Image.fromarray(np.dstack(draw(90 + i, 80, seed=i))).save(folder / f"p{i}.png")
    (folder / "broken.jpg").write_bytes(b"\xff\xd8\xff broken")
    words = ("photo", folder, "--out", out, "--light", "key:#ffeedd@45,30", "--weights", weights, "--jobs", 2)
    first = CliRunner().invoke(app, [str(word) for word in words])
    assert first.exit_code == 1, first.output
    assert "3 relit, 0 already there, 1 failed" in first.output and "broken.jpg" in first.output
    before = {p: p.stat().st_mtime_ns for p in out.glob("*/relit.png")}
    assert len(before) == 3
    (folder / "broken.jpg").unlink()
    with pytest.MonkeyPatch.context() as patch, pytest.raises(RuntimeError):  # killed before the end
        patch.setattr("relight.photos.folder.write_light_files", Mock(side_effect=RuntimeError))
        run("photo", folder / "p1.png", "--light", "even", "--out", out / "p1.png", "--weights", weights)
    (out / "p2.png" / "relit.png").unlink()
    monkeypatch.setattr("relight.photos.folder.has_semaphores", lambda: False)  # then this process does it
    assert "2 relit, 1 already there, 0 failed" in run(*words)
    after = {p: p.stat().st_mtime_ns for p in out.glob("*/relit.png")}
    changed = {p.parent.name for p in before if before[p] != after[p]}
    assert changed == {"p1.png", "p2.png"}


def test_the_folder_here_is_relit_beside_itself(photo_files, monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr("relight.photos.folder.relight_photos", lambda *given, **_: asked.append(given[2]))
    monkeypatch.chdir(tmp_path)
    CliRunner().invoke(app, ["photo", "."])
    assert asked == [tmp_path.with_name(f"{tmp_path.name}_relit")]
    (tmp_path / "frames.v2").mkdir()
    assert relit(Path("frames.v2")).name == "frames.v2_relit" and relit(Path("b/a.b.jpg")) == Path("b/a.b_relit")


@pytest.mark.slow
def test_several_photos_and_the_picture_alone(photo_files, run, weights, monkeypatch, tmp_path):
    me, mask, *_ = photo_files
    words = ("--light", "room:3", "--weights", weights, "--jobs", 1)
    monkeypatch.setattr("relight.photos.folder.has_semaphores", lambda: False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "b").mkdir()
    for name in ("you.png", "you_mask.png", "b/me.png"):
        (tmp_path / name).write_bytes((mask if "mask" in name else me).read_bytes())
    assert "2 relit, 0 already there, 0 failed" in run("photo", me, "you.png", *words)
    with pytest.raises(UserError, match=r"have one name, and so would their results"):
        run("photo", me, "b/me.png", *words)
    with pytest.raises(UserError, match="there is no file b"):
        run("photo", me, "b", *words)
    for name in ("one.png", "one.jpeg"):
        assert run("photo", me, "--out", name, *words).startswith(name)
    assert np.array_equal(picture("one.png"), picture("relit/you.png/relit.png"))
    assert np.abs(picture("one.jpeg").astype(int) - picture("one.png")).mean() < 20  # of noise
    Image.open(me).save("you.jfif", format="JPEG")
    Image.fromarray(np.dstack([picture(me), picture(mask)])).save("cut.png")
    said = run("photo", "cut.png", "--out", "cut.jpg", "--lit-by", "you.jfif", *words)
    assert "what is transparent is white, since the result is opaque" in said


def test_changed_options_or_files_are_relit_again(photo_files, weights, tmp_path):
    me, mask, _, _ = photo_files
    looks = [Look(), Look(stops=1), Look("room:3"), Look("room:3", background="panorama"), Look("room:4")]

    def fingerprints():
        given = [(look, load(weights).network.digest) for look in looks] + [(Look(), load().network.digest)]
        return [_fingerprint((me, mask), *each) for each in given]  # the last is of the weights that ship

    before = fingerprints()
    assert before == fingerprints() and len(set(before)) == len(before)
    place = _fingerprint((me,), Look(f"place:{mask}@20"))
    Image.new("L", (140, 180), 9).save(mask)
    assert place != _fingerprint((me,), Look(f"place:{mask}@20"))
    assert not {*before} & {*fingerprints()}


@pytest.mark.slow
def test_photo_writes_the_photo_beside_the_result(photo_files, weights, tmp_path, run):
    photo, _, pixels, _ = photo_files
    height, width = pixels.shape[:2]
    for background in ("keep", "transparent"):
        run("photo", photo, "-w", weights, "--background", background, "--out", tmp_path)
        strip, relit = picture(tmp_path / "before_after.jpg").astype(float), Image.open(tmp_path / "relit.png")
        assert strip.shape[0] == height and strip.shape[1] > 2 * width
        shown = Image.new("RGBA", relit.size, "white")
        shown.alpha_composite(relit.convert("RGBA"))
        assert np.abs(strip[:, :width] - pixels).mean() < 15
        assert np.abs(strip[:, -width:] - np.asarray(shown.convert("RGB"))).mean() < 15


@pytest.mark.slow
def test_opposite_lamp_is_on_the_side_from_which_no_light_comes(relighter, draw):
    pixels, mask = draw()
    scene = relighter.scene(pixels, mask)
    for x, side in ((0.5, -50), (-0.5, 50)):
        light = np.zeros((9, 3), np.float32)
        light[0], light[3] = 1, x
        assert replace(scene, people=[replace(scene.people[0], light=light)]).lamp == f"key:#ffe6c8@{side},40,0.3"
    np.testing.assert_array_equal(relighter.relight(pixels, mask), relighter.relight(pixels, mask, scene.lamp))
