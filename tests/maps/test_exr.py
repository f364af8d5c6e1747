"""Maps survive the trip through OpenEXR, under names that other programs read, and broken files are told apart."""

import re

import numpy as np
import OpenEXR
import pytest
from samples import random_maps

from relight.core.errors import UserError
from relight.maps import LeftOut, read_info, read_maps, write_left_out, write_maps


@pytest.mark.parametrize("order", [0, 2, 3])
@pytest.mark.parametrize("bounced", [False, True])
def test_round_trip(tmp_path, order, bounced):
    maps = random_maps(order=order, bounced=bounced)
    write_maps(tmp_path / "a.exr", maps)
    back = read_maps(tmp_path / "a.exr")
    for name in ("coverage", "albedo", "normal", "ao", "transport", *(["bounced"] if bounced else [])):
        given, read = getattr(maps, name), getattr(back, name)
        assert read.dtype == np.float32 and read.shape == given.shape, name
        np.testing.assert_array_equal(read, given.astype(np.float16).astype(np.float32), err_msg=name)
    np.testing.assert_array_equal(back.mask, maps.mask)
    np.testing.assert_array_equal(back.depth, maps.depth)
    assert back.bounced is None or bounced
    assert back.info == {**maps.info, "pixels": int(maps.mask.sum())} == read_info(tmp_path / "a.exr")
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_gloss_comes_back_where_there_is_some(tmp_path):
    maps = random_maps()
    maps.gloss = np.random.default_rng(3).random((9, 9, 2)).astype(np.float32)
    write_maps(tmp_path / "a.exr", maps)
    back = read_maps(tmp_path / "a.exr")
    np.testing.assert_array_equal(back.gloss, maps.gloss.astype(np.float16).astype(np.float32))
    assert read_info(tmp_path / "a.exr")["gloss"] is True
    write_maps(tmp_path / "matt.exr", random_maps())
    assert read_maps(tmp_path / "matt.exr").gloss is None and "gloss" not in read_info(tmp_path / "matt.exr")


def test_layers_are_named_for_other_programs(tmp_path):
    write_maps(tmp_path / "a.exr", random_maps(bounced=True))
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    names = set(file.channels())
    wanted = {"albedo.R", "normal.Z", "ao.Y", "depth.Z", "mask.A", "transport.L0M0.Y", "transport.L2Mn2.Y"}
    assert wanted | {"transport.L1M1.Y", "bounced.L2M2.B"} <= names
    assert all(re.fullmatch(r"([A-Za-z][A-Za-z0-9]*\.)+[RGBAXYZ]", name) for name in names)
    assert "1/pi" in file.header()["convention"] and "+z toward the camera" in file.header()["frame"]
    assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION
    assert file.channels()["transport.L0M0.Y"].pixels.dtype == np.float16


def test_left_out_foreign_and_broken_files_are_refused(tmp_path):
    write_left_out(tmp_path / "a.exr", {"name": "a"}, "all faces are degenerate")
    assert read_info(tmp_path / "a.exr") == {"name": "a", "left_out": "all faces are degenerate"}
    with pytest.raises(LeftOut, match="all faces are degenerate"):
        read_maps(tmp_path / "a.exr")
    with pytest.raises(UserError, match="no file"):
        read_maps(tmp_path / "none.exr")
    (tmp_path / "text.exr").write_text("not an image")
    pixels = {"R": np.zeros((4, 4), np.float16)}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, pixels).write(str(tmp_path / "foreign.exr"))
    OpenEXR.File({"type": OpenEXR.scanlineimage, "software": "relight 1"}, pixels).write(str(tmp_path / "photo.exr"))
    write_maps(tmp_path / "good.exr", random_maps(size=40))
    whole = (tmp_path / "good.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(whole[: len(whole) // 2])
    says = {"text": "not a readable", "foreign": "not a file of maps", "photo": "inferred from", "cut": "cut.exr"}
    for name, words in says.items():
        with pytest.raises(UserError, match=words):
            read_maps(tmp_path / f"{name}.exr")


@pytest.mark.parametrize(("rows", "columns", "place", "says"), [
    (slice(40), slice(12, 31), (12, 0), r"19 x 40 at \(12, 0\) of a picture of 40 x 40"),
    (slice(5, 30), slice(40), (0, 5), r"40 x 25 at \(0, 5\) of"),
    (slice(5, 30), slice(12, 31), (0, 0), r"19 x 25 at \(0, 0\) of"),
    (slice(40), slice(40), (5, 0), r"40 x 40 at \(5, 0\) of a picture of 40 x 40, but its maps fill one"),
    (slice(40), slice(40), (0, 0), None),
])  # fmt: skip
def test_maps_that_another_program_cropped_or_moved_are_refused(tmp_path, rows, columns, place, says):
    write_maps(tmp_path / "a.exr", random_maps(size=40))
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    layers = {name: np.ascontiguousarray(layer.pixels[rows, columns]) for name, layer in file.channels().items()}
    height, width = layers["mask.A"].shape
    header = {"relight": file.header()["relight"], "displayWindow": (np.int32([0, 0]), np.int32([39, 39]))}
    header["dataWindow"] = np.int32(place), np.int32(np.add(place, (width - 1, height - 1)))
    OpenEXR.File(header, layers).write(str(tmp_path / "b.exr"))
    if says is None:
        np.testing.assert_array_equal(read_maps(tmp_path / "b.exr").albedo, read_maps(tmp_path / "a.exr").albedo)
        return
    for read in (read_info, read_maps):
        with pytest.raises(UserError, match=says):
            read(tmp_path / "b.exr")
