"""The layout of captures: what is read, and what is refused in one sentence."""

import json
import re
import shutil

import capture_twin as twin
import numpy as np
import pytest
from PIL import Image

from relight.captures.capture import capture_files, list_captures, read_capture
from relight.config import ROOT
from relight.errors import UserError
from relight.srgb import encode, to_bytes

CAMERAS = {"anna.front": 0, "anna.back": 2}
LAMPS = 40


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("captures")
    for name, number in CAMERAS.items():
        twin.write_capture(folder, name, number, LAMPS)
    return folder


@pytest.fixture
def copy(captures, tmp_path):
    """The folder of a capture that may be broken."""
    return shutil.copytree(captures / "anna.front", tmp_path / "anna.front")


def test_list_captures_selects_by_name(captures, tmp_path):
    assert list(list_captures(captures)) == ["anna.back", "anna.front"]
    assert list_captures(captures, "front$") == {"anna.front": captures / "anna.front"}
    (captures / "no_capture").mkdir(exist_ok=True)
    assert len(list_captures(captures)) == 2
    with pytest.raises(UserError, match=r"holds no PERSON\.VIEW/capture\.json$"):
        list_captures(tmp_path)
    with pytest.raises(UserError, match=r"holds no PERSON\.VIEW/capture\.json whose name matches ben"):
        list_captures(captures, "ben")
    with pytest.raises(UserError, match=r"'\(' is not a regular expression"):
        list_captures(captures, "(")


def test_capture_files_are_those_that_exist(copy):
    assert all(path.exists() for path in capture_files(copy)) and copy / "mesh.obj" in capture_files(copy)
    (copy / "mesh.obj").unlink()
    assert all(path.exists() for path in capture_files(copy)) and len(capture_files(copy)) == 3


@pytest.mark.parametrize("name", CAMERAS)
def test_read_capture_has_the_camera_that_took_the_frames(captures, name):
    capture, seen = read_capture(captures / name), twin.surface(CAMERAS[name])
    assert (capture.name, capture.subject) == (name, "anna") and capture.mesh == captures / name / "mesh.obj"
    row, column = np.nonzero(seen["mask"])
    points = seen["point"][row, column]
    assert np.allclose(capture.camera.project(points), np.stack([column, row], -1) + 0.5, atol=1e-3)
    rays = capture.camera.rays(column + 0.5, row + 0.5)
    assert np.allclose(rays[:, :3] + rays[:, 3:] * capture.camera.depth(points)[:, None], points, atol=0.01)
    assert np.array_equal(capture.mask == 255, seen["mask"])


def test_read_frames_gives_each_lamp_its_own_frame(captures):
    capture, seen = read_capture(captures / "anna.front"), twin.surface(0)
    frames = dict(capture.read_frames(seen["mask"]))
    assert list(frames) == list(range(LAMPS)) and len(capture.lamps) == LAMPS
    for number, position in enumerate(capture.lamps):
        assert np.array_equal(frames[number], to_bytes(encode(twin.lit(seen, position)))[seen["mask"]])


def edit(*keys, value):
    """Returns a function that changes an entry of a capture's capture.json."""

    def change(folder):
        content = json.loads((folder / "capture.json").read_text())
        part = content
        for key in keys[:-1]:
            part = part[key]
        part[keys[-1]] = value
        (folder / "capture.json").write_text(json.dumps(content))

    return change


def write(text):
    return lambda folder: (folder / "capture.json").write_bytes(text)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda folder: (folder / "capture.json").unlink(), r"capture: there is no file .*capture\.json"),
        (write(b"{"), "is not JSON in UTF-8"),
        (write(b"\xff\xfe"), "is not JSON in UTF-8"),
        (write(b"[" * 100_000), "is not JSON in UTF-8"),
        (write(b"[]"), "camera must be an object"),
        (edit("lamps", value={}), "lamps must be a list"),
        (edit("lamps", 3, value=7), "frame must be a text"),
        (edit("lamps", 3, "position", value=[1, 2]), "position must be 3 finite numbers"),
        (edit("lamps", 3, "position", value=[1, 2, "x"]), "position must be 3 finite numbers"),
        (edit("lamps", 3, "position", value=[1, 2, float("nan")]), "position must be 3 finite numbers"),
        (edit("lamps", 3, "frame", value="frames/004.png"), "names a frame twice"),
        (edit("lamps", 3, "frame", value="../other/frames/000.png"), "must be a file of the folder frames"),
        (edit("lamps", 3, "frame", value="frames/.."), "must be a file of the folder frames"),
        (edit("lamps", 3, "frame", value="/etc/passwd"), "must be a file of the folder frames"),
        (edit("camera", "intrinsics", value=[[1, 0], [0, 1]]), "intrinsics must be 3 x 3 finite numbers"),
        (edit("camera", "intrinsics", 0, value=[-9, 0, 5]), "focal lengths in intrinsics must be positive"),
        (edit("camera", "extrinsics", 0, value=[2, 0, 0, 5]), "extrinsics must be a rotation and a translation"),
        (edit("camera", "extrinsics", value=(-np.eye(3, 4)).tolist()), "extrinsics must be a rotation and a"),
        (lambda folder: (folder / "mask.png").unlink(), r"mask: there is no file .*mask\.png"),
        (lambda folder: (folder / "mask.png").write_bytes(b"\x89PNG"), r"mask\.png is damaged, or no picture"),
    ],
)  # fmt: skip
def test_read_capture_refuses(copy, change, words):
    change(copy)
    with pytest.raises(UserError, match=words) as caught:
        read_capture(copy)
    assert "\n" not in str(caught.value)


def test_read_frames_refuses_broken_frames(copy):
    frame = copy / "frames" / "020.png"
    kept = frame.read_bytes()
    inside = read_capture(copy).mask >= 128
    for spoil, words in (
        (lambda: frame.write_bytes(kept[: len(kept) // 2]), r"020\.png is damaged, or no picture"),
        (lambda: Image.new("RGB", (40, 64)).save(frame), r"020\.png is 40x64 pixels, but the mask is 48x64"),
        (lambda: Image.new("I;16", (48, 64)).save(frame), r"020\.png has more than 8 bits per channel"),
        (frame.unlink, r"frame: there is no file .*020\.png"),
    ):
        spoil()
        with pytest.raises(UserError, match=words):
            list(read_capture(copy).read_frames(inside))


def test_read_capture_as_documented(tmp_path):
    block = re.search(r"```json\n(.*?)```", (ROOT / "docs" / "scans.md").read_text(), re.S)[1]
    folder = tmp_path / "anna.front"
    folder.mkdir()
    (folder / "capture.json").write_text(block)
    Image.new("L", (810, 1440), 255).save(folder / "mask.png")
    capture = read_capture(folder)
    assert len(capture.lamps) == 2 and capture.mesh is None
    assert np.allclose(capture.camera.eye, [0, 1, 4]) and np.allclose(capture.camera.rotation, np.eye(3))
