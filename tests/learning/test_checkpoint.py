"""Networks on disk."""

import json

import pytest
import torch
from safetensors.torch import load_file, save_file

from relight.core.errors import UserError
from relight.learning.checkpoint import load_network, save_network
from relight.learning.networks import build


@pytest.fixture
def network(model):
    torch.manual_seed(0)
    network = build(model(), 64).train()
    network(torch.rand(4, 3, 64, 64), torch.ones(4, 1, 64, 64))  # moves the running statistics off their start
    return network


def test_round_trip(network, model, tmp_path):
    save_network(tmp_path / "n.safetensors", network, model(), train={"color": "photo"}, card="a fact")
    before = torch.random.get_rng_state()
    loaded, config = load_network(tmp_path / "n.safetensors")
    assert torch.equal(torch.random.get_rng_state(), before)
    assert config == {"size": 64, "model": vars(model()), "train": {"color": "photo"}, "card": "a fact"}
    assert not loaded.training
    state = loaded.state_dict()
    assert all(torch.equal(value, state[name]) for name, value in network.state_dict().items())
    image, mask = torch.rand(1, 3, 64, 64), torch.ones(1, 1, 64, 64)
    network.eval()
    assert all(torch.equal(value, loaded(image, mask)[name]) for name, value in network(image, mask).items())


def test_user_errors(network, model, tmp_path):
    with pytest.raises(UserError, match=r"there is no file .*none\.safetensors"):
        load_network(tmp_path / "none.safetensors")
    torch.save({"weights": torch.zeros(3)}, tmp_path / "pickle")
    save_network(tmp_path / "cut", network, model())
    (tmp_path / "cut").write_bytes((tmp_path / "cut").read_bytes()[:5000])
    save_file({"a": torch.zeros(2)}, tmp_path / "other")
    for name, says in (("pickle", "not a safetensors"), ("cut", "not a safetensors"), ("other", "holds no relight")):
        with pytest.raises(UserError, match=f"{name} .*{says}"):
            load_network(tmp_path / name)


@pytest.mark.parametrize("change", [{"size": 65}, {"model": {"name": "ours"}}, {"model": None}, {}])
def test_a_network_of_another_shape_is_refused(network, model, tmp_path, change):
    path = tmp_path / "n.safetensors"
    save_network(path, network, model())
    weights = load_file(path)
    if not change:
        weights.pop("light.last.weight")
    save_file(weights, path, metadata={"relight": json.dumps({"size": 64, "model": vars(model())} | change)})
    with pytest.raises(UserError):
        load_network(path)
