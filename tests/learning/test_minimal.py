"""examples/train_minimal.py is the network and the loss of the package, written out."""

import re
import runpy
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from relight.learning.data import RelitSet
from relight.learning.losses import losses
from relight.learning.networks import build
from relight.settings import ROOT


@pytest.fixture(scope="module")
def minimal():
    return SimpleNamespace(**runpy.run_path(str(ROOT / "examples" / "train_minimal.py")))


@pytest.fixture(scope="module")
def folder(world, tmp_path_factory):
    """The world, laid out as results are."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "lights").mkdir()
    (folder / "packed.safetensors").symlink_to(world["packed"])
    (folder / "lights" / "lights.npz").symlink_to(world["lights"])
    return folder


@pytest.mark.parametrize("size", [64, 128, 256])
def test_network_infers_what_the_package_does(minimal, model, size):
    torch.manual_seed(1)
    twin, network = minimal.Network(size, 0.125), build(model(albedo="straight_through"), size)
    with torch.no_grad():
        for mine, theirs in zip(twin.parameters(), network.parameters(), strict=True):
            mine.copy_(theirs)
    image, mask = torch.rand(2, 3, size, size), (torch.rand(2, 1, size, size) > 0.3).float()
    outputs = network.eval()(image, mask)
    albedo, transport, light = twin.eval()(image, mask)
    torch.testing.assert_close(albedo, outputs["albedo"] * mask)
    torch.testing.assert_close(transport, outputs["transport"] * mask)
    torch.testing.assert_close(light, outputs["light"])


def test_loss_is_the_fifteen_of_the_package(minimal, world, folder, loss):
    mask, albedo, transport, lights = minimal.read_data(folder)
    batch = RelitSet(world["packed"], world["lights"], 2, "photo").batch(np.array([0, 2]), np.array([1, 3]))
    truth = albedo[[0, 2]], transport[[0, 2]], lights[[1, 3]]
    torch.manual_seed(2)
    inferred = [x + 0.1 * torch.randn_like(x) for x in truth]
    inferred = [inferred[0] * mask[[0, 2]], inferred[1] * mask[[0, 2]], inferred[2]]
    # The package shades with the bands beyond order 2, too: its truth is made that of the example.
    batch = type(batch)(**{**vars(batch), "shading": batch.gather(minimal.shade(*truth[1:]))})
    batch = type(batch)(**{**vars(batch), "relit": batch.albedo * batch.shading})
    expected, values = losses(dict(zip(("albedo", "transport", "light"), inferred)), batch, loss())
    assert len(values) == 15
    torch.testing.assert_close(minimal.loss(inferred, truth, mask[[0, 2]]), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.slow
def test_example_trains_and_draws_what_it_relit(minimal, folder, tmp_path, monkeypatch, capsys):
    out = tmp_path / "minimal.png"
    words = ["train_minimal.py", str(folder), "--steps", "60", "--width", ".125", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", words)
    minimal.main()
    printed = capsys.readouterr().out
    errors = re.findall(r"relit figure [\d.]+; of its image", printed)
    first, last = (float(re.findall(r"loss ([\d.]+)", printed)[i]) for i in (0, -1))
    assert len(errors) == 2 and last < 0.7 * first
    pixels = np.asarray(Image.open(out))
    assert pixels.shape == (2 * 64, 5 * 64, 3) and (pixels[:, -64:] < 250).any()
