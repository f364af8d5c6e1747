"""The order of all tests, and what several files of tests share."""

import fcntl
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


def pytest_configure():
    """Programs that tests start find the package of this repository, whatever is installed."""
    paths = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    os.environ["PYTHONPATH"] = os.pathsep.join(paths)


def pytest_collection_modifyitems(items):
    """Files with slow tests come first, the workflow's before all: processes deal files out among them, and none is to
    be left alone with a long one at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path not in slow, item.path.parent.name != "workflow"))


@pytest.fixture(scope="session")
def once(tmp_path_factory) -> Callable[[str, Callable[[Path], object]], Path]:
    """The function that makes a folder, by its name and what fills it, once for all processes of pytest-xdist: the
    first that asks for it fills it, and others wait. Tests change nothing in it."""
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent

    def made(name: str, fill: Callable[[Path], object]) -> Path:
        folder = base / name
        with open(base / f"{name}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (folder / "whole").exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                (folder / "whole").touch()
        return folder

    return made


@pytest.fixture(scope="session")
def check_page() -> Callable[[str, dict], None]:
    """The function that compares a section of docs/lab/files.md with tables of kinds by the form of their file: each
    row is a kind there, by its name, whose last two entries are the value and the words of the note."""

    def check(section: str, tables: dict[str, dict[str, tuple]]) -> None:
        page = (Path(__file__).parents[1] / "docs" / "lab" / "files.md").read_text()
        lines = page.split(f"\n## {section}\n")[1].split("\n## ")[0].splitlines()
        rows = [line.strip("|").split(" | ") for line in lines if line.startswith("| ")][1:]
        assert rows
        for file, says, value, words in ([cell.strip() for cell in row] for row in rows):
            *_, true, said = tables[file][says]
            np.testing.assert_allclose(np.array(value.split(), float), true, atol=6e-4, err_msg=says)
            assert words in said and bool(words) == bool(said), says

    return check


@pytest.fixture(scope="session")
def exported_network(once) -> Path:
    """The folder of a small network of 128 px with all that exports differently from how it is trained: its checkpoint
    a.safetensors, and a.onnx. Its maps lie where those of people do."""

    def fill(folder: Path) -> None:
        import torch

        from relight.learning.checkpoint import load_network, save_network
        from relight.learning.export import export
        from relight.learning.networks import build
        from relight.settings import Model, composed

        torch.set_num_threads(1)
        torch.manual_seed(0)
        changes = {"name": "unet", "width": 0.125, "norm": "batch", "light_head": "pooled", "dropout": 0.0}
        settings = Model(**{**dict(composed().model), **changes, "refine": True, "rescale": 0.5, "rebalance": 0.3})
        network = build(settings, 128).train()
        with torch.no_grad():
            network.last.bias.copy_(torch.tensor([0.8, 0.1, 0.3, 0.1, 0, 0, 0, 0, 0, 0.5, 0.4, 0.3]))
            network.light.last.bias[:3] = 0.8
            network(torch.rand(4, 3, 128, 128), torch.ones(4, 1, 128, 128))  # moves the running statistics
            torch.nn.init.normal_(network.refinement.coupling, 0, 0.3)
        save_network(folder / "a.safetensors", network.eval(), settings, train={"color": "photo"})
        network, config = load_network(folder / "a.safetensors")
        export(network, folder / "a.onnx", config)

    return once("exported", fill)


@pytest.fixture(scope="session")
def figure(once):
    """A draft figure in three outfits, the second of three of one person, which no training has drawn."""

    def fill(folder: Path) -> None:
        from relight.figures.make import make_figure

        make_figure(5005, "draft", 128, per_subject=3, outfits=3).save(folder / "figure.npz")

    from relight.meshes import Mesh

    return Mesh.load(once("figure", fill) / "figure.npz")


@pytest.fixture(scope="session")
def empty_store(once) -> Path:
    """A database of MLflow without runs: to make one takes seconds."""

    def fill(folder: Path) -> None:
        from relight.lab.tracking.store import create_database

        create_database(f"sqlite:///{folder}/empty.db")

    return once("store", fill) / "empty.db"


@pytest.fixture(scope="session", name="weights")
def tiny_network(tmp_path_factory) -> Path:
    """A network for photos, 64 px, as relight.photos.network reads it: random, but for a transport like that of a
    surface, so that shadings are positive; enough for all that is not about quality."""
    import onnx

    rng, light = np.random.default_rng(3), np.zeros((9, 3), np.float32)
    light[:4] = np.array([[0.8], [0.15], [0.2], [-0.1]]) * rng.uniform(0.8, 1.2, (4, 3))
    constants = {
        "weight": rng.normal(0, 0.1, (12, 3, 5, 5)).astype(np.float32),
        "bias": np.array([0, 0, 0, 0.8, 0.2, 0.3, 0, 0, 0, 0, 0, 0], np.float32),
        "base": light[None],
        "one": np.float32(1),
        "row": np.array([-1, 1, 3], np.int64),
        "sizes": np.array([3, 9], np.int64),
    }
    model = onnx.parser.parse_model("""
        <ir_version: 8, opset_import: ["": 18]>
        tiny (float[B,3,H,W] image, float[B,1,H,W] mask)
            => (float[B,3,H,W] albedo, float[B,9,H,W] transport, float[B,9,3] light) {
          maps = Conv <pads = [2, 2, 2, 2]> (image, weight, bias)
          first, second = Split <axis = 1> (maps, sizes)
          color = Sigmoid (first)
          albedo = Mul (color, mask)
          transport = Mul (second, mask)
          mean = GlobalAveragePool (image)
          tint = Reshape (mean, row)
          factor = Add (tint, one)
          light = Mul (base, factor)
        }""")
    stored = [onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    model.graph.initializer.extend(stored)
    lights = (light * rng.uniform(0.5, 1.5, (12, 9, 3))).ravel().round(4).tolist()
    config = {"size": 64, "model": {"order": 2}, "train": {"color": "photo"}, "lights": lights}
    onnx.helper.set_model_props(model, {"relight": json.dumps(config)})
    path = tmp_path_factory.mktemp("weights") / "tiny.onnx"
    onnx.save(model, path)
    return path
