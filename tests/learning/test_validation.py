"""Validation touches nothing: losses of fixed pairs, and a picture whose rows agree for a perfect network."""

import copy
import json

import numpy as np
import pytest
import torch
from torch import nn

from relight.learning.data import RelitSet
from relight.learning.losses import losses
from relight.learning.networks import build
from relight.learning.validation import GAP, Validation, ball_cell
from relight.sh import UNOCCLUDED_T00


class Oracle(nn.Module):
    """A network that knows the truth."""

    def __init__(self, batch):
        super().__init__()
        self.batch = batch

    def forward(self, image, mask):
        dense = {name: self.batch.scatter(getattr(self.batch, name)) for name in ("albedo", "transport")}
        return {**dense, "light": self.batch.light}


@pytest.fixture(params=["paper", "photo"])
def validation(request, world, loss):
    data = RelitSet(world["packed"], world["lights"], 3, request.param)
    return Validation(data, world["split"], loss(tv_albedo=0.0, tv_transport=0.0), data.size)


def test_what_a_perfect_network_infers_is_the_truth(validation):
    values, picture = validation(Oracle(validation.batch), drawn=True)
    assert values["loss"] < 1e-6 and set(values) > {"albedo", "transport", "light", "shading_light"}
    height = (picture.shape[0] - GAP) // 2
    truth, inferred = picture[:height], picture[-height:]
    assert picture.dtype == np.uint8 and truth.std() > 20
    np.testing.assert_allclose(truth.astype(int), inferred, atol=1)


def test_the_values_are_the_losses_and_nothing_is_left_behind(validation, model):
    network = build(model(order=3), validation.batch.size).train()
    network.get_submodule(next(iter(dict(network.named_children())))).eval()  # as `train.only` leaves it
    modes, state = [part.training for part in network.modules()], copy.deepcopy(network.state_dict())
    drawn = torch.get_rng_state()
    values, picture = validation(network)
    assert picture is None and torch.equal(drawn, torch.get_rng_state())
    assert modes == [part.training for part in network.modules()]
    assert all(torch.equal(value, state[name]) for name, value in network.state_dict().items())
    with torch.inference_mode():
        batch = validation.batch
        total, found = losses(network.eval()(batch.image, batch.mask), batch, validation.loss)
    assert values["albedo"] == pytest.approx(float(found["albedo"]))
    assert values["loss"] == pytest.approx(float(total), rel=1e-5)


def test_pairs_are_of_validation_figures_and_lights_and_without_them_there_is_none(tmp_path, world, loss):
    data = RelitSet(world["packed"], world["lights"], 2, "paper")
    found = Validation(data, world["split"], loss(), data.size)
    wanted = data.batch(data.figures(["figure5"]), np.flatnonzero(data.light_split == "validation"))
    assert found.pairs == 1
    torch.testing.assert_close(found.batch.image, wanted.image)
    torch.testing.assert_close(found.batch.light, wanted.light)
    (split := tmp_path / "split.json").write_text('{"train": ["figure0"], "test": ["figure4"]}')
    assert Validation(data, split, loss(), data.size)(nn.Identity(), drawn=True) == ({}, None)


@pytest.mark.parametrize("count", [1, 5])
def test_any_number_of_pairs_makes_a_picture(tmp_path, world, loss, count):
    dealt = {"train": [], "validation": [f"figure{i}" for i in range(count)], "test": []}
    (tmp_path / "split.json").write_text(json.dumps(dealt))
    validation = Validation(RelitSet(world["packed"], world["lights"], 2, "paper"), tmp_path / "split.json", loss(), 64)
    _, picture = validation(Oracle(validation.batch), drawn=True)
    assert validation.pairs == count and picture.ndim == 3 and picture.shape[2] == 3
    assert picture.shape[0] <= 2 * (2 * 64 + GAP) + 4 * GAP, "no more than four are drawn"


@pytest.mark.parametrize(("linear", "code"), [(False, 0.25), (True, 0.5371)])
def test_the_ball_has_the_scale_of_the_panels(linear, code):
    light = np.zeros((9, 3))
    light[0] = 0.5 / UNOCCLUDED_T00  # an irradiance of 0.5
    np.testing.assert_allclose(ball_cell(light, (20, 30), 2.0, linear)[10, 15], code, atol=1e-3)
