"""The nodes in ComfyUI's conventions, loaded as its `nodes.py` does, and the example workflow run through them."""

import importlib.util
import json
import os
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from relight.core import srgb
from relight.core.errors import UserError
from relight.lights import Light, load_light
from relight.panoramas import Panorama, generate_room, project
from relight.sh import rotate_y

ROOT = Path(__file__).parents[2]
PACK = ROOT / "integrations" / "comfyui"
WEB = ROOT / "relight" / "viewer" / "web"
PLAIN = ("ratio", "matched to the picture", 0.0, 0.0)


@pytest.fixture(scope="module")
def pack():
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


@pytest.fixture(scope="module")
def portrait():
    """An IMAGE (1,256,256,3) and a MASK (1,256,256) of the portrait."""
    image, mask = (Image.open(WEB / name).resize((256, 256)) for name in ("astronaut.jpg", "astronaut_mask.png"))
    codes, coverage = np.asarray(image.convert("RGB"), np.float32), np.asarray(mask.convert("L"), np.float32)
    return torch.from_numpy(codes / 255)[None], torch.from_numpy(coverage / 255)[None]


def test_every_node_declares_what_comfyui_reads(pack, nodes):
    assert nodes.keys() == pack.NODE_DISPLAY_NAME_MAPPINGS.keys()
    for node in nodes.values():
        inputs = node.INPUT_TYPES()
        names = [*inputs["required"], *inputs.get("optional", {})]
        run = getattr(node, node.FUNCTION)
        assert list(run.__code__.co_varnames[1 : run.__code__.co_argcount]) == names
        assert len(node.RETURN_TYPES) == len(node.RETURN_NAMES) and node.CATEGORY and node.DESCRIPTION
        for kind, *_ in [*inputs["required"].values(), *inputs.get("optional", {}).values()]:
            assert isinstance(kind, list) or kind in {"IMAGE", "MASK", "STRING", "FLOAT", "RELIGHT_LIGHT"}


def test_relight_changes_the_people_alone(nodes, portrait):
    image, mask = portrait
    (light,) = nodes["RelightNamedLight"]().run("key:#ff8040@80,10,0.05")
    relit, alpha = nodes["RelightRelight"]().run(image, light, *PLAIN, mask)
    assert relit.shape == image.shape and relit.dtype == torch.float32 and 0 <= relit.min() and relit.max() <= 1
    assert (alpha - mask).abs().mean() < 0.01, "but for its edge, which is fitted to the image"
    outside = alpha[0] == 0
    torch.testing.assert_close(relit[0][outside], image[0][outside], atol=1e-4, rtol=0)
    red, blue = (relit / image.clamp_min(0.02))[0][mask[0] == 1].mean(0)[[0, 2]]
    assert red > 1.2 * blue


def test_relight_by_the_inferred_light_gives_back_the_image(pack, nodes, portrait):
    image, mask = portrait
    module = sys.modules[nodes["RelightRelight"].__module__]
    (scene,) = module.scenes(image, mask)
    relit, _ = nodes["RelightRelight"]().run(image, Light(scene.light, "astronaut.jpg"), *PLAIN, mask)
    torch.testing.assert_close(relit, image, atol=2e-5, rtol=0)


def test_inference_is_done_once_for_a_picture_and_its_mask(nodes, portrait, monkeypatch):
    image, mask = portrait
    module = sys.modules[nodes["RelightRelight"].__module__]
    module.scene_of.cache_clear()
    calls, scene = [], module.relighter().scene
    monkeypatch.setattr(module.relighter(), "scene", lambda *words: calls.append(1) or scene(*words))
    for name in ("room:1", "room:2"):
        nodes["RelightRelight"]().run(image, *nodes["RelightNamedLight"]().run(name), *PLAIN, mask)
    assert len(calls) == 1
    nodes["RelightRelight"]().run(image.flip(2), *nodes["RelightNamedLight"]().run("room:1"), *PLAIN, mask.flip(2))
    assert len(calls) == 2


def test_batches_take_one_mask_or_one_each(nodes, portrait):
    image, mask = portrait
    (light,) = nodes["RelightNamedLight"]().run("room:3")
    pair, masks = torch.cat([image, image.flip(2)]), torch.cat([mask, mask.flip(2)])
    relit, alpha = nodes["RelightRelight"]().run(pair, light, *PLAIN, masks)
    alone, _ = nodes["RelightRelight"]().run(image, light, *PLAIN, mask[0])
    assert relit.shape == pair.shape and alpha.shape == masks.shape
    torch.testing.assert_close(relit[:1], alone)
    with pytest.raises(ValueError, match="2 masks for 1 pictures"):
        nodes["RelightRelight"]().run(image, light, *PLAIN, masks)


def test_background_lies_behind_the_people(nodes, portrait):
    image, mask = portrait
    (light,) = nodes["RelightNamedLight"]().run("room:3")
    green = torch.zeros(1, 64, 64, 3)
    green[..., 1] = 0.5
    relit, _ = nodes["RelightRelight"]().run(image, light, *PLAIN, mask, green)
    away = relit[0, :40][mask[0, :40] == 0]
    assert (away[:, 1] > away[:, 0] + 0.2).all() and (away[:, 1] > away[:, 2] + 0.2).all()


@pytest.mark.parametrize("encoding", ["linear", "sRGB"])
def test_light_of_a_panorama_is_that_of_its_generator(nodes, encoding):
    pixels = generate_room(5).clip(0, 1 if encoding == "sRGB" else None)
    values = srgb.encode(pixels) if encoding == "sRGB" else pixels
    (light,) = nodes["RelightPanoramaLight"]().run(torch.from_numpy(values.astype(np.float32))[None], encoding)
    expected = load_light("room:5").coefficients if encoding == "linear" else project(Panorama(pixels))
    np.testing.assert_allclose(light.coefficients, expected, rtol=1e-4, atol=1e-4)
    assert not np.allclose(expected, rotate_y(expected, np.pi), atol=0.05)
    with pytest.raises(ValueError, match="twice as wide as high"):
        nodes["RelightPanoramaLight"]().run(torch.zeros(1, 8, 8, 3), encoding)


def test_maps_times_each_other_are_about_the_image(nodes, portrait):
    image, mask = portrait
    albedo, shading, alpha, normal = nodes["RelightInferMaps"]().run(image, mask)
    assert albedo.shape == shading.shape == normal.shape == image.shape and alpha.shape == mask.shape
    inside = (mask[0] == 1).numpy()
    product = srgb.decode(albedo[0].numpy()) * srgb.decode(shading[0].numpy()) * 2
    codes, expected = srgb.encode(product.clip(0, 1))[inside], image[0].numpy()[inside]
    assert np.corrcoef(codes.ravel(), expected.ravel())[0, 1] > 0.95 and np.abs(codes - expected).mean() < 0.1
    assert (albedo[0].numpy()[alpha[0].numpy() == 0] == 0).all()
    vectors = 2 * normal[0].numpy() - 1
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 1, atol=3e-3)
    assert (vectors[alpha[0].numpy() == 0] == [0, 0, 1]).all()
    columns = np.broadcast_to(np.arange(256) - 128, inside.shape)[inside]  # the left side of a body faces left
    assert vectors[..., 2][inside].mean() > 0.6 and np.corrcoef(columns, vectors[..., 0][inside])[0, 1] > 0.2


def test_a_light_that_is_none_is_refused_in_one_sentence(nodes):
    with pytest.raises(UserError, match="room:x"):
        nodes["RelightNamedLight"]().run("room:x")


def test_a_changed_file_is_a_changed_light(nodes, tmp_path):
    path = tmp_path / "light.npy"
    np.save(path, np.eye(9, 3))
    node = nodes["RelightNamedLight"]
    before = node.IS_CHANGED(str(path))
    os.utime(path, ns=(1, 1))
    assert node.IS_CHANGED(str(path)) != before and node.IS_CHANGED("room:7") == "room:7"


def test_the_example_workflow_runs(nodes, portrait):
    """By a small executor: links carry outputs to inputs, and widgets come in the order of the inputs."""
    image, mask = portrait
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
            inputs = cls.INPUT_TYPES()["required"]
            kinds = {name: kind for name, (kind, *_) in inputs.items()}
            widgets = [name for name in kinds if isinstance(kinds[name], list) or kinds[name] in ("STRING", "FLOAT")]
            out = getattr(cls(), cls.FUNCTION)(**given, **dict(zip(widgets, node["widgets_values"], strict=True)))
        for slot, value in enumerate(out):
            values[node["id"], slot] = value
    assert len(shown) == 3 and all(picture.shape == image.shape for picture in shown)
    assert {"RelightFindMask", "RelightNamedLight", "RelightRelight", "RelightInferMaps"} <= types


def test_registry_gets_its_fields_and_no_torch():
    document = tomllib.loads((PACK / "pyproject.toml").read_text())
    project, comfy = document["project"], document["tool"]["comfy"]
    assert re.fullmatch(r"[a-zA-Z](?:[-_.]?[a-zA-Z0-9])*", project["name"]) and len(project["name"]) < 100
    assert "comfyui" not in project["name"].lower() and re.fullmatch(r"\d+\.\d+\.\d+", project["version"])
    assert project["license"] == {"text": "Apache-2.0"} and {"PublisherId", "DisplayName"} <= comfy.keys()
    assert [re.match(r"[\w-]+", line)[0] for line in project["dependencies"]] == ["relight"]
