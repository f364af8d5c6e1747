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


@pytest.fixture
def few_resamples(monkeypatch):
    """Intervals of tables from 200 resamples, which are fast; comparisons do not use them."""
    monkeypatch.setattr("relight.evaluation.scoring.tables.estimate", partial(estimate, resamples=200))


@pytest.fixture(scope="session")
def small_network():
    """The function that saves an untrained network for 64 px: to a path, by its name and color model."""

    def save(path: Path, name: str, color: str) -> None:
        model = OmegaConf.to_object(config.composed([f"model={name}", "model.width=0.125", "model.norm=batch"])).model
        torch.manual_seed(1)
        save_network(path, build(model, 64), model, train={"color": color})

    return save


@pytest.fixture(scope="session")
def world(tmp_path_factory) -> World:
    """Six figures at 64 px, three of them to test on, six lights, two of them to test with."""
    folder, names = tmp_path_factory.mktemp("world"), [f"snowman{seed:02d}" for seed in range(6)]
    paths = [folder / f"{name}.exr" for name in names]
    for seed, path in enumerate(paths):
        write_maps(path, snowman(64, seed))
    pack_maps(paths, folder / "packed.safetensors")
    split = np.array(["train"] * 4 + ["test"] * 2)
    np.savez(folder / "lights.npz", coefficients=some_lights(6, 7), split=split)
    (folder / "split.json").write_text(json.dumps({"train": names[:3], "test": names[3:]}))
    return World(folder / "packed.safetensors", folder / "lights.npz", folder / "split.json", paths)
