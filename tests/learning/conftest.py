"""A small world to learn from: lit ellipsoids with painted stripes, packed as the figures are."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from relight.maps import Maps, pack_maps, write_maps
from relight.settings import NO_AUGMENTATION, Loss, Model, Train
from relight.sh import unoccluded

SIZE = 64
torch.set_num_threads(1)


def figure(rng: np.random.Generator, name: str, size: int = SIZE, order: int = 2) -> Maps:
    """An ellipsoid in a well that darkens it toward its rim: its transport is not that of its normals."""
    row, column = np.mgrid[:size, :size]
    x, y = (2 * column + 1) / size - 1, 1 - (2 * row + 1) / size
    width, height = rng.uniform(0.25, 0.5), rng.uniform(0.6, 0.85)
    u, v = x / width, y / height
    mask, w = u**2 + v**2 < 1, np.sqrt(np.maximum(1 - u**2 - v**2, 0))
    normal = np.stack([u / width, v / height, w / 0.3], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    share = 0.4 + 0.6 * w
    transport = unoccluded(normal, order) * share[..., None]
    transport[..., 1] += 0.1 * share * (1 - share)  # the well opens upward
    stripes = np.sin(x[..., None] * rng.uniform(4, 9, 3) + y[..., None] * rng.uniform(4, 9, 3) + rng.uniform(0, 6, 3))
    albedo = 0.35 + 0.25 * np.sign(stripes)
    maps = {"albedo": albedo, "normal": normal, "transport": transport, "ao": share, "depth": 1 - w}
    where = {2: mask, 3: mask[..., None]}
    maps = {key: (value * where[value.ndim]).astype(np.float32) for key, value in maps.items()}
    info = {"name": name, "subject": name, "size": size, "order": order, "rays": 1, "seed": 0}
    return Maps(mask=mask, coverage=mask.astype(np.float32), info=info, **maps)


def make_world(folder: Path, size: int = SIZE) -> dict[str, Path]:
    """Paths packed, lights, split of 6 figures (4 to train on) and 7 lights (4 to train on), order 3."""
    rng, other = np.random.default_rng(7), np.random.default_rng(8)
    names = [f"figure{i}" for i in range(6)]
    for name in names:
        write_maps(folder / f"{name}.exr", figure(other if name == names[-1] else rng, name, size, order=3))
    paths = {"packed": folder / "packed.safetensors", "lights": folder / "lights.npz", "split": folder / "split.json"}
    pack_maps([folder / f"{name}.exr" for name in names], paths["packed"])
    lights = 0.25 * rng.normal(size=(6, 16, 3)).astype(np.float32)
    lights[:, 0] = rng.uniform(0.7, 1.0, (6, 3))
    lights[:, 2] += 0.3
    lights = np.concatenate([lights, 0.5 * (lights[:1] + lights[3:4])])
    split = np.array(["train", "test", "train", "train", "unusual", "train", "validation"])
    np.savez(paths["lights"], coefficients=lights, split=split, source=np.array([f"room {i}" for i in range(7)]))
    dealt = {"train": names[:4], "validation": [names[5]], "test": [names[4], "left out"]}
    paths["split"].write_text(json.dumps(dealt))
    return paths


@pytest.fixture(scope="session")
def world(tmp_path_factory):
    """A data set at 64 px, the least that a network takes."""
    return make_world(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="session")
def tiny_world(tmp_path_factory):
    """The same at 16 px, for what is computed pixel by pixel in Python."""
    return make_world(tmp_path_factory.mktemp("tiny"), 16)


@pytest.fixture(scope="session")
def model():
    """Model settings: the demo's, an eighth as wide."""
    settings = dict(name="ours", width=0.125, norm="batch", dropout=0.5, order=2, albedo="clip")
    settings |= dict(light_head="strided", refine=False, sees="image")
    return lambda **changes: Model(**{**settings, **changes})


@pytest.fixture(scope="session")
def loss():
    names = "albedo transport light tv_albedo tv_transport shading reconstruction reconstruction_full".split()
    return lambda **changes: Loss(**{**dict.fromkeys(names, 1.0), **changes})


@pytest.fixture(scope="session")
def schedule():
    """Training settings: eight steps of the demo's."""
    settings = dict(steps=8, batch=4, lr=2e-3, beta1=0.9, schedule="cosine", warmup=2, epoch=4)
    settings |= dict(color="paper", seed=0, device="cpu", precision="f32", pairs="shuffled")
    settings |= dict(optimizer="adam", average=0.0, mirror=False, compile=False)
    return lambda **changes: Train(**{**settings, **changes})


@pytest.fixture(scope="session")
def augment():
    return lambda **changes: replace(NO_AUGMENTATION, **changes)
