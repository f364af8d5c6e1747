"""The diagram's graph against the network as its docstring describes it."""

import pytest
import torch
from omegaconf import OmegaConf
from PIL import Image

from relight import config
from relight.evaluation.diagram import INPUT, draw_network, layers_of
from relight.learning.networks import build


def network(name: str, size: int = 128):
    model = OmegaConf.to_object(config.composed([f"model={name}", "model.width=0.125", "model.norm=batch"])).model
    torch.manual_seed(0)
    return build(model, size)


def test_the_papers_network_is_a_chain_with_skips_and_a_light_from_three_places():
    made = network("ours")
    layers, outputs = layers_of(made)
    convolutions = [n for n, m in made.named_modules() if isinstance(m, (torch.nn.Conv2d, torch.nn.ConvTranspose2d))]
    assert sorted(layer.name for layer in layers) == sorted(convolutions)
    by_lane = {}
    for layer in layers:
        by_lane.setdefault(layer.lane, []).append(layer)
    encoder = by_lane["encoder"]
    assert [layer.side for layer in encoder] == [64, 32, 16, 8, 4, 2] and encoder[0].sources == [INPUT]
    assert [layer.sources for layer in encoder[1:]] == [[one.name] for one in encoder[:-1]]
    for lane, channels in (("decoders.transport", 9), ("decoders.albedo", 3)):
        first, second, *up = by_lane[lane]
        assert first.sources == [encoder[-1].name] and second.sources == [first.name]
        assert up[0].sources == [encoder[-1].name, second.name]  # the residual block adds its input
        skips = zip(up[1:], up[:-1], encoder[-2::-1], strict=True)
        assert all(layer.sources == [skip.name, below.name] for layer, below, skip in skips)
        assert (up[-1].channels, up[-1].side) == (channels, 128) and outputs[lane.split(".")[1]] == [up[-1].name]
    light = by_lane["light"]
    residuals = [by_lane[lane][1].name for lane in ("decoders.transport", "decoders.albedo")]
    assert set(light[0].sources) == {encoder[-1].name, *residuals} and light[-1].channels == 27
    assert outputs["light"] == [light[-1].name]


def test_a_layer_that_sees_the_picture_again_says_so():
    layers, outputs = layers_of(network("unet"))
    again = [layer.name for layer in layers[1:] if INPUT in layer.sources]
    assert again == ["sharpen"] and outputs["albedo"] == outputs["transport"] == ["last"]


@pytest.mark.parametrize("name", ["sfsnet_ao", "ours_plus"])
def test_a_diagram_is_drawn_and_the_network_is_left_as_it_was(tmp_path, name):
    made = network(name)
    before = {key: value.clone() for key, value in made.state_dict().items()}
    assert made.training
    draw_network(made, "A network", tmp_path / "network.png")
    assert Image.open(tmp_path / "network.png").width > 1000 and made.training
    assert all(torch.equal(value, before[key]) for key, value in made.state_dict().items())
    assert not any(module._forward_hooks or module._forward_pre_hooks for module in made.modules())
    assert all(weight.grad is None for weight in made.parameters())
