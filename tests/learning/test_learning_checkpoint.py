"""Networks on disk."""

import json
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location

import pytest
import torch
from safetensors.torch import load_file, save_file

from relight.config import ROOT
from relight.errors import UserError
from relight.learning.checkpoint import load_network, save_network
from relight.learning.data import RelitSet
from relight.learning.networks import build
from relight.learning.train import Recipe, draw_batch, select_training_data


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


@pytest.mark.slow
def test_reading_a_network_does_not_bring_in_torchs_compiler(network, model, tmp_path):
    """It costs a CPU-second, a seventh of what a photo takes; drawing weights without memory would import it."""
    save_network(tmp_path / "n.safetensors", network, model())
    code = "import sys; from relight.learning.checkpoint import load_network; load_network(sys.argv[1]); "
    code += "print('torch._dynamo' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code, tmp_path / "n.safetensors"], capture_output=True, text=True)
    assert run.stdout.strip() == "False", run.stderr


@pytest.mark.slow
def tool(name):
    """A program of the folder tools, as a module."""
    spec = spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_mean_of_two_networks(network, model, world, loss, schedule, augment, tmp_path):
    """Its statistics are those of its own activations, so it infers as it does with those of a batch."""
    start, end, out = (tmp_path / f"{name}.safetensors" for name in ("start", "end", "out"))
    settings = {"loss": vars(loss()), "train": vars(schedule()), "augment": vars(augment())}
    save_network(start, network, model(), stages=[1])
    torch.manual_seed(1)
    save_network(end, build(model(), 64), model(), **settings, stages=[1, 2], fingerprint="of the end alone")
    averaging = tool("mean")
    averaging.BATCHES = 8
    averaging.main(start, end, out, *world.values(), share=0.7)
    first, last, mean = (load_file(path) for path in (start, end, out))
    weights = {name for name in mean if "running" not in name and mean[name].is_floating_point()}
    for name in weights:
        torch.testing.assert_close(mean[name], 0.3 * first[name] + 0.7 * last[name])
    made, made_with = load_network(out)
    assert made_with["stages"] == [1, 2] and "mean" in made_with["note"] and "fingerprint" not in made_with
    recipe = Recipe(model(), loss(), schedule(seed=5, batch=16), augment())
    data = RelitSet(world["packed"], world["lights"], 2, "paper")
    batch = draw_batch(data, *select_training_data(data, world["split"], recipe.train), recipe, 0, 0, 1)
    plain, _ = load_network(start)
    plain.load_state_dict({name: mean[name] if name in weights else tensor for name, tensor in first.items()})
    differences = []
    for candidate in (made, plain):
        by_statistics = candidate(batch.image, batch.mask)
        for module in candidate.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.train()
        by_batch = candidate(batch.image, batch.mask)
        differences.append(sum(float((by_batch[name] - by_statistics[name]).abs().mean()) for name in by_batch))
    assert differences[0] < 0.5 * differences[1], differences


def test_a_widened_network_computes_the_same(model, tmp_path):
    torch.manual_seed(2)
    settings = model(name="unet", light_head="pooled", refine=True, dropout=0.0)
    network = build(settings, 64).train()
    network(torch.rand(4, 3, 64, 64), torch.ones(4, 1, 64, 64))
    save_network(tmp_path / "a.safetensors", network, settings, stages=[1])
    tool("widen").main(tmp_path / "a.safetensors", 0.2, tmp_path / "b.safetensors")
    wide, made_with = load_network(tmp_path / "b.safetensors")
    assert made_with["model"]["width"] == 0.2 and made_with["stages"] == [1]
    assert sum(p.numel() for p in wide.parameters()) > 1.5 * sum(p.numel() for p in network.parameters())
    mask = (torch.rand(2, 1, 64, 64) > 0.3).float()
    image = torch.rand(2, 3, 64, 64) * mask
    expected = network.eval()(image, mask)
    for name, values in wide(image, mask).items():
        torch.testing.assert_close(values, expected[name], atol=1e-5, rtol=1e-4)


def test_user_errors(network, model, tmp_path):
    with pytest.raises(UserError, match=r"there is no file .*none\.safetensors"):
        load_network(tmp_path / "none.safetensors")
    path = tmp_path / "n.safetensors"
    torch.save({"weights": torch.zeros(3)}, path)
    with pytest.raises(UserError, match="is not a safetensors file"):
        load_network(path)
    save_network(path, network, model())
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(UserError, match="is not a safetensors file"):
        load_network(path)
    save_file({"a": torch.zeros(2)}, path)
    with pytest.raises(UserError, match="holds no relight network"):
        load_network(path)


@pytest.mark.parametrize("change", [{"size": 65}, {"model": {"name": "ours"}}, {"model": None}, {}])
def test_a_network_of_another_shape_is_refused(network, model, tmp_path, change):
    path = tmp_path / "n.safetensors"
    save_network(path, network, model())
    weights = load_file(path)
    if not change:
        weights.pop("light.last.weight")
    config = {"size": 64, "model": vars(model())} | change
    save_file(weights, path, metadata={"relight": json.dumps(config)})
    with pytest.raises(UserError):
        load_network(path)
