"""The file of docs/workflow.md: network, loss, light and figure are chosen by its name, and nothing else is edited."""

import re
import subprocess
import sys

import numpy as np
import pytest
from repo import copy, relight

from relight import extensions
from relight.core.errors import UserError
from relight.lights import load_light
from relight.panoramas import project
from relight.settings import ROOT, check, composed, resolved

PAGE = (ROOT / "docs" / "workflow.md").read_text()
EXAMPLE = re.search(r"```python\n# relight/extensions/mine\.py\n(.*?)```", PAGE, re.S)
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
USE = """
import json, sys
from pathlib import Path
from relight import extensions
extensions.__path__.append(sys.argv[1])
import torch
from relight.settings import Loss, composed, resolved, check
from relight.core.errors import UserError
from relight.learning.checkpoint import load_network, save_network
from relight.learning.networks import build
from relight.lights import load_light
from relight.figures.make import save_figure
from omegaconf import OmegaConf
words = ["scale=smoke", "model.name=mine", "+loss.extra.mine=0.5", "figures.source=mine", "figures.per_subject=4"]
config = resolved(composed(words))
check(config)
settings = OmegaConf.to_object(config)
torch.manual_seed(0)
network = build(settings.model, 64)
outputs = network(torch.rand(2, 3, 64, 64), torch.ones(2, 1, 64, 64))
assert outputs["albedo"].shape == (2, 3, 64, 64) and outputs["transport"].shape == (2, 9, 64, 64)
assert outputs["light"].shape == (2, 9, 3) and (outputs["light"] == 1).all()
save_network(Path("mine.safetensors"), network, settings.model)
again = load_network(Path("mine.safetensors"))[0]
assert type(again).__name__ == "network" and torch.equal(again.maps.weight, network.maps.weight)
from relight.learning.export import export
assert export(again, Path("mine.onnx"), {"train": {"color": "photo"}}) < 1e-4
light = load_light("mine:2.5", order=1).coefficients
assert light.shape == (4, 3) and (light[0] == 2.5).all() and not light[1:].any()
assert settings.loss.extra == {"mine": 0.5}
save_figure("g0007", settings.figures, Path("g0007.npz"))
from relight.meshes import Mesh
mesh = Mesh.load(Path("g0007.npz"))
assert len(mesh.faces) == 4 and (mesh.info["name"], mesh.info["subject"]) == ("g0007", "s0001")
"""


@pytest.mark.slow
def test_the_file_of_the_docs_works(tmp_path):
    """In a process of its own, since choices of settings are made when they are imported."""
    for name, text in {"files/mine.py": EXAMPLE[1], "people/0007.obj": TETRAHEDRON}.items():
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
    command = [sys.executable, "-c", USE, str(tmp_path / "files")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.slow
def test_a_changed_file_makes_again_what_was_made_of_it(tmp_path):
    """By dry runs; a file that no figure is made of does not count."""
    repo = copy(tmp_path)
    (repo / "relight" / "extensions" / "mine.py").write_text(EXAMPLE[1])
    (repo / "people").mkdir()
    for seed in range(8, 12):
        (repo / "people" / f"{seed:04d}.obj").write_text(TETRAHEDRON)
    words = ["run", "scale=smoke", "figures.source=mine", "figures.first=9", "figures.count=2", "track.uri=null"]
    made = relight(repo, *words, "--target", "figure")
    assert made.returncode == 0, made.stdout
    figures = repo.joinpath("results", "smoke", "figures")
    assert sorted(path.name for path in figures.glob("*/*.npz")) == ["g0009.npz", "g0010.npz"], made.stdout
    for seed, again in ((8, 0), (9, 0), (10, 1)):
        file = repo / "people" / f"{seed:04d}.obj"
        file.write_text(TETRAHEDRON.replace("v 1 0 0", "v 2 0 0") if seed != 9 else TETRAHEDRON)
        told = relight(repo, *words, "--target", "figure", "-n").stdout
        assert re.findall(r"^figure +(\d)$", told, re.M) == [str(again)] * again, told
        assert ("was made of another ../../people/0010.obj" in told) == again, told


def test_what_is_not_there_is_named(tmp_path, monkeypatch):
    (tmp_path / "half.py").write_text("def loss(outputs, batch): return 0\n")
    monkeypatch.setattr(extensions, "__path__", [*extensions.__path__, str(tmp_path)])
    assert extensions.names() == ("half",) and extensions.extension("half", "loss")(None, None) == 0
    for name, says in (("half", r"extensions\.half defines no `network`"), ("os", r"no file os\.py in relight/ext")):
        with pytest.raises(UserError, match=says):
            extensions.extension(name, "network")
    (tmp_path / "broken.py").write_text("def light(text, order) return None\n")
    broken = r"the extension broken cannot be imported: .*\(broken\.py, line 1\)"
    for name, says in (("half", "half defines no `light`"), ("broken", broken)):
        with pytest.raises(UserError, match=says):
            load_light(f"{name}:3")


def test_an_installed_package_offers_an_extension(tmp_path, monkeypatch):
    (tmp_path / "guest.py").write_text("def loss(outputs, batch): return 7\n")
    (about := tmp_path / "guest-1.dist-info").mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: guest\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[relight.extensions]\nguest_loss = guest\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    extensions.installed.cache_clear()
    try:
        assert "guest_loss" in extensions.names() and extensions.extension("guest_loss", "loss")(None, None) == 7
        with pytest.raises(UserError, match="guest defines no `network`"):
            extensions.extension("guest_loss", "network")
        check(resolved(composed(["scale=smoke", "+loss.extra.guest_loss=1"])))
    finally:
        extensions.installed.cache_clear()


@pytest.mark.parametrize(("word", "says"), [
    ("+loss.extra.mine=1", "loss.extra.mine: there is no file mine.py in relight/extensions"),
    ("loss.extra.mine=1", r"nothing has this name yet; to add it, write \+loss\.extra\.mine=<value>"),
    ("+loss.extra.half=-1", r"loss\.extra must be in \[0, 1000000\], not \{.*-1\.0\}"),
    ("+loss.extra.half=nan", r"loss\.extra must be in \[0, 1000000\], not \{.*nan\}"),
])  # fmt: skip
def test_wrong_weights(word, says, tmp_path, monkeypatch):
    (tmp_path / "half.py").touch()
    monkeypatch.setattr(extensions, "__path__", [str(tmp_path)])
    with pytest.raises(UserError, match=says):
        check(resolved(composed(["scale=smoke", word])))


def test_a_light_with_a_panorama_is_turned_whole(tmp_path, monkeypatch):
    (tmp_path / "probe1.py").write_text("from relight.lights import load_light as light\n")
    monkeypatch.setattr(extensions, "__path__", [*extensions.__path__, str(tmp_path)])
    light = load_light("probe1:room:7:20", yaw=30.0, flip=True)
    np.testing.assert_allclose(project(light.panorama, 2), light.coefficients, atol=1e-5 * light.coefficients.max())
    assert np.abs(light.coefficients - load_light("room:7:20").coefficients).max() > 0.1
