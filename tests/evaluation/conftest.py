"""A small world with a closed form: figures of two ellipsoids, their transport that of an open surface times an AO."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from samples import snowman

from relight import settings as config
from relight.evaluation.scoring.statistics import estimate
from relight.learning.checkpoint import save_network
from relight.learning.networks import build
from relight.maps import pack_maps, write_maps
from relight.sh import basis, unoccluded


@dataclass
class World:
    packed: Path
    lights: Path
    split: Path
    maps: list[Path]
    condition: str = "test"


def some_lights(count: int, seed: int) -> np.ndarray:
    """(count,9,3): ambient light and a few lobes from in front, brightest channel's frontal irradiance at .8."""
    rng, lights = np.random.default_rng(seed), np.zeros((count, 9, 3))
    lights[:, 0] = 0.5
    for light in lights:
        for _ in range(rng.integers(1, 4)):
            direction = rng.normal(size=3)
            direction[2] = abs(direction[2])
            light += 0.4 * basis(direction / np.linalg.norm(direction))[:, None] * rng.uniform(0.5, 1.5, 3)
        light *= 0.8 / (unoccluded(np.array([0.0, 0, 1])) @ light).max()
    return lights.astype(np.float32)


def make_world(folder: Path, size: int, figures: int, lights: int, test: int) -> World:
    paths = [folder / f"snowman{seed:02d}.exr" for seed in range(figures)]
    for seed, path in enumerate(paths):
        write_maps(path, snowman(size, seed))
    pack_maps(paths, folder / "packed.safetensors")
    split = np.array(["train"] * (lights - 2) + ["test"] * 2)
    np.savez(folder / "lights.npz", coefficients=some_lights(lights, 7), split=split)
    names = [path.stem for path in paths]
    (folder / "split.json").write_text(json.dumps({"train": names[:-test], "test": names[-test:]}))
    return World(folder / "packed.safetensors", folder / "lights.npz", folder / "split.json", paths)


def save_small_network(path: Path, name: str, color: str, seed: int = 1) -> None:
    model = OmegaConf.to_object(config.composed([f"model={name}", "model.width=0.125", "model.norm=batch"])).model
    torch.manual_seed(seed)
    save_network(path, build(model, 64), model, train={"color": color})


@pytest.fixture
def few_resamples(monkeypatch):
    """Intervals of tables from 200 resamples, which are fast; comparisons do not use them."""
    monkeypatch.setattr("relight.evaluation.scoring.tables.estimate", partial(estimate, resamples=200))


@pytest.fixture(scope="session")
def small_network():
    return save_small_network


@pytest.fixture(scope="session")
def world(tmp_path_factory) -> World:
    """Six figures at 64 px, three of them to test on, six lights, two of them to test with."""
    return make_world(tmp_path_factory.mktemp("world"), 64, 6, 6, 3)
