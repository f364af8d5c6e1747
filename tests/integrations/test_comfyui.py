"""The nodes in ComfyUI's conventions, loaded as its `nodes.py` does, and the example workflow run through them."""

import gc
import importlib.util
import json
import os
import re
import sys
import tomllib
import weakref
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image
from samples import rgbe

from relight.core import srgb
from relight.core.errors import UserError
from relight.lights import Light, load_light
from relight.panoramas import Panorama, generate_room, project
from relight.sh import rotate_y

ROOT = Path(__file__).parents[2]
PACK = ROOT / "integrations" / "comfyui"
WEB = ROOT / "relight" / "viewer" / "web"
ROOM, ORANGE = load_light("room:3"), load_light("key:#ff8040@80,10,0.05")
PLAIN = ("ratio", "matched to the picture", 0.0, 0.0)


class Interrupted(Exception):
    """As ComfyUI's InterruptProcessingException."""


@pytest.fixture(scope="module")
def comfy(tmp_path_factory):
    """What the nodes use of ComfyUI's own modules: `interrupt` at a check after so many, and `progress`, the calls."""
    state = SimpleNamespace(interrupt=-1, progress=[], texts=[], input=tmp_path_factory.mktemp("input"))

    def check():
        state.interrupt -= 1
        if state.interrupt == -1:
            raise Interrupted

    bar = SimpleNamespace(update=state.progress.append)
    names = ("comfy", "comfy.model_management", "comfy.utils", "folder_paths", "server")
    parts = {name: ModuleType(name) for name in names}
    parts["folder_paths"].get_input_directory = lambda: str(state.input)
    server = SimpleNamespace(send_progress_text=lambda text, node_id: state.texts.append((node_id, text)))
    parts["server"].PromptServer = SimpleNamespace(instance=server)
    parts["comfy.model_management"].throw_exception_if_processing_interrupted = check
    parts["comfy.utils"].ProgressBar = lambda total: state.progress.append(total) or bar
    with pytest.MonkeyPatch.context() as patch:
        for name, module in parts.items():
            setattr(parts["comfy"], name.rpartition(".")[2], module)
            patch.setitem(sys.modules, name, module)
        yield state


@pytest.fixture(scope="module")
def pack(comfy):
    """The folder, imported under a name made of its path, as ComfyUI does."""
    name = str(PACK).replace(".", "_x_")
    spec = importlib.util.spec_from_file_location(name, PACK / "__init__.py")
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules[name]


@pytest.fixture(scope="module")
def nodes(pack):
    return pack.NODE_CLASS_MAPPINGS


def values_of(name, mode):
    """A picture of the portrait as a batch of one, 256 pixels a side."""
    return torch.from_numpy(np.asarray(Image.open(WEB / name).resize((256, 256)).convert(mode), np.float32) / 255)[None]


@pytest.fixture(scope="module")
def image():
    return values_of("astronaut.jpg", "RGB")


@pytest.fixture(scope="module")
def mask():
    return values_of("astronaut_mask.png", "L")


@pytest.fixture(scope="module")
def relight(nodes):
    """The function that relights an image by a light and, where they are given, a mask and more."""
    return lambda image, light, *more, **named: nodes["RelightRelight"]().run(image, light, *PLAIN, *more, **named)


def test_every_node_declares_what_comfyui_reads(pack, nodes):
    assert nodes.keys() == pack.NODE_DISPLAY_NAME_MAPPINGS.keys()
    for node in nodes.values():
        inputs = node.INPUT_TYPES()
        assert inputs.pop("hidden") == {"unique_id": "UNIQUE_ID"}
        assert len(node.RETURN_TYPES) == len(node.RETURN_NAMES) == len(node.OUTPUT_TOOLTIPS)
        assert node.CATEGORY and node.DESCRIPTION and all(node.SEARCH_ALIASES)
        assert all(options["tooltip"] for part in inputs.values() for _, options in part.values())
        for kind, *_ in [*inputs["required"].values(), *inputs.get("optional", {}).values()]:
            assert isinstance(kind, list) or kind in {"IMAGE", "MASK", "STRING", "FLOAT", "RELIGHT_LIGHT"}


def scene_of(nodes, image, mask, encoding="sRGB"):
    module, node = sys.modules[nodes["RelightRelight"].__module__], SimpleNamespace(notes=[])
    ((_, scene),) = module.each(node, image, mask, module.inferred(image, mask, None, encoding))
    return scene


def test_relight_changes_the_people_alone(relight, image, mask):
    image = 0.9 * image  # not of 8 or 16 bits
    relit, alpha = relight(image, ORANGE, mask)
    assert relit.shape == image.shape and relit.dtype == torch.float32 and 0 <= relit.min() and relit.max() <= 1
    assert (alpha - mask).abs().mean() < 0.01, "but for its edge, which is fitted to the image"
    outside = alpha[0] == 0
    assert torch.equal(relit[0][outside], image[0][outside])
    red, blue = (relit / image.clamp_min(0.02))[0][mask[0] == 1].mean(0)[[0, 2]]
    assert red > 1.2 * blue


def test_the_inferred_light_gives_back_the_image_and_one_that_the_user_knows_replaces_it(nodes, relight, image, mask):
    relit, _ = relight(image, Light(scene_of(nodes, image, mask).light, "astronaut.jpg"), mask)
    torch.testing.assert_close(relit, image, atol=2e-5, rtol=0)
    lamp = Light(load_light("key:#ffffff@60,30,0.3").coefficients, "lamp")
    inferred, known = (relight(image, lamp, mask=mask, lit_by=by)[0] for by in (None, lamp))
    inside = mask[0] == 1
    assert (known - image)[0][inside].abs().mean() < 0.02 < (inferred - image)[0][inside].abs().mean()


def test_inference_is_done_once_for_a_picture_and_its_mask_until_comfyui_frees_it(
    nodes, relight, image, mask, monkeypatch
):
    portrait, image, module = image, image.clone(), sys.modules[nodes["RelightRelight"].__module__]
    calls, scene = [], module.relighter().scene
    monkeypatch.setattr(module.relighter(), "scene", lambda *words, **_: calls.append(1) or scene(*words))
    other = nodes["RelightInferMaps"]()
    for name in ("room:1", "room:2"):
        relight(image, load_light(name), mask)
    other.run(image, mask, encoding="".join(["s", "RGB"]))
    assert len(calls) == 1
    other.run(image, mask.clone())
    other.run(image, mask, lit_by=Light(load_light("room:1").coefficients, "known"))
    assert len(calls) == 3
    kept = weakref.ref(module.SCENES[image][3][0])
    del image
    gc.collect()
    assert kept() is None
    monkeypatch.setattr(module, "MEMORY", 1000)
    for _ in range(2):
        other.run(portrait, mask)
    assert len(calls) == 5, "large batches are not kept"


def test_batches_take_one_mask_or_one_each_of_any_size(relight, image, mask):
    pair, masks = torch.cat([image, image.flip(2)]), torch.cat([mask, mask.flip(2)])
    relit, alpha = relight(pair, ROOM, masks)
    alone, _ = relight(image, ROOM, mask[0])
    assert relit.shape == pair.shape and alpha.shape == masks.shape
    small = relight(image, ROOM, torch.nn.functional.interpolate(mask[None], scale_factor=0.5, mode="area")[0])[1]
    assert small.shape == mask.shape and (small - mask).abs().mean() < 0.03
    torch.testing.assert_close(relit[:1], alone)
    with pytest.raises(ValueError, match="2 masks for 1 pictures"):
        relight(image, ROOM, masks)
    with pytest.raises(
        ValueError, match="the mask of picture 2 is white everywhere: make it white on the people alone"
    ):
        relight(pair, ROOM, torch.cat([mask, torch.ones_like(mask)]))


def test_notes_are_told_once_a_batch_under_the_node_and_in_the_console(relight, image, mask, caplog, comfy):
    comfy.texts.clear()
    relight(image.repeat(3, 1, 1, 1), load_light("key:#fff@-150,10"), mask.repeat(3, 1, 1), unique_id="7")
    ((node_id, text),) = comfy.texts
    cut = "picture 1, 2, 3 of 3: the figure is cut by the photo's lower edge"
    assert node_id == "7" and text.count("the figure is cut") == 1 and cut in text
    assert cut in caplog.text and "comes from behind" in text
    assert "comes from behind: faces suffer; a turn of 150 brings it to the front" in caplog.text


@pytest.mark.parametrize("kind", ["empty", "opaque"])
def test_a_frame_that_shows_nobody_passes_as_it_is(nodes, relight, image, mask, caplog, kind):
    if kind == "opaque":  # ComfyUI's mask of a picture without alpha
        relit, alpha = relight(image, ROOM, torch.zeros(1, 64, 64))
        assert torch.equal(relit, image) and not alpha.any() and alpha.shape == mask.shape
        return
    pair, masks = torch.cat([image.flip(2), image]), torch.cat([torch.zeros_like(mask), mask])
    relit, alpha = relight(pair, ROOM, masks)
    alone, own = relight(image, ROOM, mask)
    assert torch.equal(relit[0], pair[0]) and not alpha[0].any()
    torch.testing.assert_close((relit[1:], alpha[1:]), (alone, own))
    assert "picture 1 of 2: passed on as it is: the mask is empty" in caplog.text
    maps = nodes["RelightInferMaps"]().run(pair, masks)
    assert not any(values[0].any() for values in maps[:3]) and maps[0][1].any()
    assert (maps[3][0] == torch.tensor([0.5, 0.5, 1])).all()


@pytest.mark.parametrize("name", ["RelightRelight", "RelightInferMaps", "RelightFindMask"])
def test_every_frame_is_a_step_that_can_be_interrupted(nodes, image, mask, comfy, monkeypatch, name):
    batch = image.repeat(3, 1, 1, 1)
    found = SimpleNamespace(coverage=np.zeros((256, 256), np.uint8), notes=[])
    monkeypatch.setattr(sys.modules[nodes[name].__module__], "masked", lambda picture: found)
    given = {"RelightRelight": (ROOM, *PLAIN, mask), "RelightInferMaps": (mask,), "RelightFindMask": ()}[name]
    comfy.progress.clear()
    nodes[name]().run(batch, *given)
    assert comfy.progress == [3, 1, 1, 1]
    comfy.progress.clear()
    monkeypatch.setattr(comfy, "interrupt", 2)
    with pytest.raises(Interrupted):
        nodes[name]().run(batch, *given)
    assert comfy.progress == [3, 1, 1]


def test_half_floats_are_taken_as_they_are(nodes, relight, image, mask):
    half = [values.to(torch.bfloat16) for values in (image, mask)]
    for run in (lambda image, mask: relight(image, ORANGE, mask), nodes["RelightInferMaps"]().run):
        torch.testing.assert_close(run(*half), run(*(values.float() for values in half)))


@pytest.mark.parametrize("encoding", ["sRGB", "linear"])
def test_values_above_one_stay(nodes, relight, image, mask, encoding):
    """Under its own light a picture that is four times as bright stays so; codes go on along sRGB's curve."""
    linear = 4 * srgb.decode(image[0].numpy()).astype(np.float32)
    codes = np.where(linear > 1, 1.055 * linear ** (1 / 2.4) - 0.055, srgb.encode(linear))
    values = linear if encoding == "linear" else codes
    bright = torch.from_numpy(values.astype(np.float32))[None]
    scene = scene_of(nodes, bright, mask, encoding)
    np.testing.assert_allclose(scene.picture.pixels, linear, rtol=1e-4, atol=1e-6)
    relit, _ = relight(bright, Light(scene.light, "astronaut.jpg"), mask, None, encoding)
    assert relit.max() > 1.5 and relit.dtype == torch.float32
    torch.testing.assert_close(relit, bright, atol=1e-3, rtol=1e-3)
    other, _ = relight(bright, ROOM, mask, None, encoding)
    assert other[mask > 0.5].max() > 1


def test_lights_are_turned_made_brighter_and_added(nodes):
    lamp, other = (load_light(name) for name in ("key:#fff@30,20,0", "room:5"))
    light, _ = nodes["RelightCombineLights"]().run(lamp, 60.0, 1.0, other)
    expected = 2 * load_light("key:#fff@90,20,0").coefficients + other.coefficients
    np.testing.assert_allclose(light.coefficients, expected, atol=1e-9)
    assert str(light) == "key:#fff@30,20,0 + room:5"
    _, shown = nodes["RelightCombineLights"]().run(lamp, 60.0, 0.0)
    assert shown.shape[0] == 1 and shown.dtype == torch.float32 and shown[0, 128, 200].mean() > shown[0, 128, 56].mean()
    turned, _ = nodes["RelightCombineLights"]().run(other, -40.0, 1.0)
    np.testing.assert_allclose(turned.coefficients, 2 * load_light("room:5", yaw=-40).coefficients, atol=1e-9)


def test_the_registry_reads_the_version_of_comfyui_that_the_nodes_need():
    """`comfy node validate` takes an operator and three numbers, and drops all else without failing."""
    tool = tomllib.loads((PACK / "pyproject.toml").read_text())["tool"]["comfy"]
    assert re.fullmatch(r">=\d+\.\d+\.\d+", tool["requires-comfyui"])
    needed = tuple(map(int, tool["requires-comfyui"][2:].split(".")))
    assert needed >= (0, 3, 31), "the first with PromptServer.send_progress_text"


def test_without_relight_the_pack_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "relight.photos", None)
    spec = importlib.util.spec_from_file_location("bare_pack", PACK / "__init__.py")
    with pytest.raises(ImportError, match=r"relight is not installed, .*: run `pip install \.` with ComfyUI's Python"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    lines = (PACK / "requirements.txt").read_text().splitlines()
    assert all(line.startswith("#") for line in lines), "another package of that name may come to the index"


def test_background_lies_behind_the_people(relight, image, mask):
    green = torch.zeros(1, 64, 64, 3)
    green[..., 1] = 0.5
    relit, _ = relight(image, ROOM, mask, green)
    away = relit[0, :40][mask[0, :40] == 0]
    assert (away[:, 1] > away[:, 0] + 0.2).all() and (away[:, 1] > away[:, 2] + 0.2).all()


@pytest.mark.parametrize("encoding", ["linear", "sRGB"])
def test_light_of_a_panorama_is_that_of_its_generator(nodes, encoding):
    pixels = generate_room(5).clip(0, 1 if encoding == "sRGB" else None)
    values = srgb.encode(pixels) if encoding == "sRGB" else pixels
    (light,) = nodes["RelightPanoramaLight"]().run(torch.from_numpy(values.astype(np.float32))[None], encoding)
    expected = load_light("room:5").coefficients if encoding == "linear" else project(Panorama(pixels))
    np.testing.assert_allclose(light.coefficients[:9], expected, rtol=1e-4, atol=1e-4)
    assert not np.allclose(expected, rotate_y(expected, np.pi), atol=0.05)
    with pytest.raises(ValueError, match="twice as wide as high"):
        nodes["RelightPanoramaLight"]().run(torch.zeros(1, 8, 8, 3), encoding)


def test_maps_times_each_other_are_about_the_image(nodes, image, mask):
    albedo, shading, alpha, normal = nodes["RelightInferMaps"]().run(image, mask)
    assert albedo.shape == shading.shape == normal.shape == image.shape and alpha.shape == mask.shape
    inside = (mask[0] == 1).numpy()
    product = srgb.decode(albedo[0].numpy()) * srgb.decode(shading[0].numpy()) * 2
    codes, expected = srgb.encode(product.clip(0, 1))[inside], image[0].numpy()[inside]
    assert np.corrcoef(codes.ravel(), expected.ravel())[0, 1] > 0.93 and np.abs(codes - expected).mean() < 0.12
    assert (albedo[0].numpy()[alpha[0].numpy() == 0] == 0).all()
    vectors = 2 * normal[0].numpy() - 1
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 1, atol=3e-3)
    assert (vectors[alpha[0].numpy() == 0] == [0, 0, 1]).all()
    columns = np.broadcast_to(np.arange(256) - 128, inside.shape)[inside]  # the left side of a body faces left
    assert vectors[..., 2][inside].mean() > 0.6 and np.corrcoef(columns, vectors[..., 0][inside])[0, 1] > 0.2


def test_a_light_that_is_none_is_refused_in_one_sentence(nodes):
    for name in ("room:x", "x" * 5000):
        with pytest.raises(UserError, match=name):
            nodes["RelightNamedLight"]().run(name)
    with pytest.raises(ValueError, match="auto is chosen for each picture"):
        nodes["RelightCombineLights"]().run(*nodes["RelightNamedLight"]().run("auto"), 60.0, 1.0)
    is_changed = nodes["RelightNamedLight"].IS_CHANGED
    assert is_changed(name=None, unique_id="7") is None, "it comes by a link; hidden inputs come, too"
    assert is_changed(name="x" * 5000, unique_id="7") == ("x" * 5000,)


def test_files_of_the_input_folder_are_lights_that_are_read_when_the_node_runs(nodes, comfy, tmp_path):
    pixels = rgbe(generate_room(5))
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {len(pixels)} +X {pixels.shape[1]}\n"
    (comfy.input / "mine.hdr").write_bytes(head.encode() + pixels.tobytes())
    (tmp_path / "bad.hdr").write_bytes(b"#?RADIANCE")
    named = nodes["RelightNamedLight"]
    assert not hasattr(named, "VALIDATE_INPUTS"), "ComfyUI calls it in its server's event loop"
    (light,) = named().run("mine.hdr")
    expected = load_light("room:5").coefficients
    np.testing.assert_allclose(light.coefficients[:9], expected, atol=0.01 * expected.max())
    with pytest.raises(UserError, match=r"bad\.hdr"):
        named().run(str(tmp_path / "bad.hdr"))


def test_a_changed_file_is_a_changed_light(nodes, tmp_path):
    path = tmp_path / "light.npy"
    np.save(path, np.eye(9, 3))
    node = nodes["RelightNamedLight"]
    sheet, place = tmp_path / "set.csv", tmp_path / "street.png"
    sheet.touch()
    place.touch()
    lights = ["room:7", str(path), f"even + place:{place}", f"place:{place}@-60,40", f"{sheet}:3"]
    before = [*map(node.IS_CHANGED, lights)]
    for file in (path, sheet, place):
        os.utime(file, ns=(1, 1))
    assert [node.IS_CHANGED(light) != was for light, was in zip(lights, before)] == [False, True, True, True, True]


def test_the_example_workflow_runs(nodes, relight, image, mask):
    """By a small executor: links carry outputs to inputs, and widgets come in the order of the inputs."""
    document = json.loads((PACK / "example_workflows" / "relight.json").read_text())
    types = {node["type"] for node in document["nodes"]}
    values, shown = {}, []
    for node in sorted(document["nodes"], key=lambda node: node["order"]):
        given = {}
        for entry in node["inputs"]:
            if entry["link"] is not None:
                _, source, slot, target, _, kind = next(link for link in document["links"] if link[0] == entry["link"])
                assert target == node["id"] and kind == entry["type"]
                given[entry["name"]] = values[source, slot]
        if node["type"] == "LoadImage":
            out = (image, 1 - mask)
        elif node["type"] == "PreviewImage":
            out = ()
            shown.append(given["images"])
        elif node["type"] == "RelightFindMask":  # its network is not part of the package
            out = (mask,)
        else:
            cls = nodes[node["type"]]
            kinds = {name: kind for name, (kind, *_) in cls.INPUT_TYPES()["required"].items()}
            widgets = [name for name in kinds if isinstance(kinds[name], list) or kinds[name] in ("STRING", "FLOAT")]
            out = getattr(cls(), cls.FUNCTION)(**given, **dict(zip(widgets, node["widgets_values"], strict=True)))
        for slot, value in enumerate(out):
            values[node["id"], slot] = value
    assert len(shown) == 3 and all(picture.shape == image.shape for picture in shown)
    assert {"RelightFindMask", "RelightNamedLight", "RelightRelight", "RelightInferMaps"} <= types
