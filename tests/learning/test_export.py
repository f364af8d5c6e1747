"""The exported network says what the network says, at batches and sizes that it was not exported at."""

import copy

import numpy as np
import onnx
import pytest
import torch
from scipy.ndimage import binary_erosion, maximum_filter, minimum_filter

import relight.learning.export as module
from relight.core.errors import UserError
from relight.learning.checkpoint import load_network
from relight.learning.export import PhotoGraph, _open_sized, check, clamp_rim, export, sample_inputs, smallest_side
from relight.learning.networks import build
from relight.learning.predict import predict
from relight.photos.network import read_network


@pytest.fixture(scope="module")
def exported(exported_network):
    checkpoint = exported_network / "a.safetensors"
    return load_network(checkpoint)[0], checkpoint, exported_network / "a.onnx"


@pytest.mark.parametrize("name", ["ours", "sfsnet_ao"])
def test_layers_that_are_replaced_for_the_file_compute_the_same(model, name):
    torch.manual_seed(0)
    network = build(model(name=name, norm="instance", light_head="pooled", refine=True), 128).eval()
    for weight in (*network.parameters(), network.refinement.coupling):
        if weight.ndim < 3:  # of norms, which start as if they had none
            torch.nn.init.normal_(weight, 0.8, 0.3)
    graphs = PhotoGraph(network), PhotoGraph(_open_sized(copy.deepcopy(network)))
    with torch.inference_mode():
        torch.testing.assert_close(*(graph(*sample_inputs(2, 128, 128)) for graph in graphs), rtol=1e-3, atol=1e-4)


@pytest.mark.slow
def test_export_runs_at_other_batches_and_sizes(exported):
    image, mask = sample_inputs(4, 256, 192)
    albedo, transport, light = read_network(exported[2]).run(image.numpy(), mask.numpy())
    assert albedo.shape == (4, 3, 256, 192) and transport.shape == (4, 9, 256, 192) and light.shape == (4, 9, 3)
    assert (transport[:, :, :8] == 0).all()


@pytest.mark.slow
def test_the_file_infers_the_mean_over_the_mirror_image(exported):
    """What `predict` says of both, turned back and averaged, is what the graph says inside, away from the rim."""
    network, _, path = exported
    image, mask = (values[0].numpy() for values in sample_inputs(1, 128, 128))
    image, mask = np.moveaxis(image, 0, -1), mask[0]
    one, other = predict(network, image, mask), predict(network, image[:, ::-1].copy(), mask[:, ::-1].copy())
    odd = np.ones(9)
    odd[[3, 4, 7]] = -1  # proportional to x: docs/conventions.md
    back = {"albedo": other["albedo"][:, ::-1], "transport": other["transport"][:, ::-1] * odd}
    back["light"] = other["light"] * odd[:, None]
    expected = {name: (one[name] + values) / 2 for name, values in back.items()}
    inside = binary_erosion(mask > 0)
    graph = read_network(path)
    albedo, transport, light = graph.infer(image, mask)
    for name, values in (("albedo", albedo), ("transport", transport)):
        assert np.abs(values - expected[name])[inside].max() < 2e-3
    assert np.abs(light - expected["light"]).max() < 2e-3
    assert graph.size == 128 and graph.order == 2 and graph.config["train"] == {"color": "photo"}


@pytest.mark.slow
def test_a_training_can_start_from_the_file(exported):
    """Weights keep their names, in half precision, and no layer is fused with another."""
    network, checkpoint, path = exported
    other, config = load_network(path)
    assert config["model"]["name"] == load_network(checkpoint)[1]["model"]["name"]
    for (name, first), (other_name, second) in zip(network.state_dict().items(), other.state_dict().items()):
        assert name == other_name
        if not name.endswith("num_batches_tracked"):
            torch.testing.assert_close(first, second, rtol=1e-3, atol=1e-5)


@pytest.mark.slow
def test_check_compares(exported):
    network, checkpoint, path = exported
    changed, _ = load_network(checkpoint)
    with torch.no_grad():
        changed.last.bias.add_(0.1)
    assert 0 < check(network, path)
    with pytest.raises(RuntimeError, match="differs"):
        check(changed, path)
    with torch.no_grad():
        next(changed.parameters()).fill_(torch.nan)
    with pytest.raises(RuntimeError, match="differs from torch by nan"):
        check(changed, path)


def test_export_refuses_other_suffixes(model, tmp_path):
    network = build(model(), 64)
    assert smallest_side(network) == 128
    with pytest.raises(UserError, match=r"must end in .onnx"):
        export(network, tmp_path / "a.pth", {})


@pytest.mark.parametrize("content", [b"", b"\x80\x04pickle", None], ids=["empty", "pickle", "of others"])
def test_read_network_refuses_other_files(content, tmp_path):
    path = tmp_path / "a.onnx"
    if content is None:
        text = '<ir_version: 8, opset_import: ["": 18]> a (float[1] x) => (float[1] y) { y = Relu(x) }'
        onnx.save(onnx.parser.parse_model(text), path)
    else:
        path.write_bytes(content)
    with pytest.raises(UserError, match="network"):
        read_network(path)


def clamped(maps: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Twin of `clamp_rim` by scipy's filters: maps (H,W,C), mask (H,W) bool."""
    inside = binary_erosion(mask)
    size = module.NEIGHBOURHOOD, module.NEIGHBOURHOOD, 1
    low = minimum_filter(np.where(inside[..., None], maps, np.inf), size, mode="nearest")
    high = maximum_filter(np.where(inside[..., None], maps, -np.inf), size, mode="nearest")
    rim = (mask & ~inside & (low[..., 0] < np.inf))[..., None]
    low, high = (np.where(rim, bound, maps) for bound in (low, high))
    slack = module.SLACK * (high - low)
    return np.clip(maps, low - slack, high + slack)


@pytest.mark.parametrize("seed", range(3))
def test_clamp_rim_is_that_of_plain_filters(seed):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:40, :48]
    mask = (np.hypot(x - 20, y - 24) < 16) | (rng.random((40, 48)) > 0.97)
    mask[20:, 40:] = True  # reaches the border
    maps = rng.normal(0, 0.5, (40, 48, 3)).astype(np.float32)
    tensors = torch.from_numpy(maps).permute(2, 0, 1)[None], torch.from_numpy(mask)[None, None].float()
    np.testing.assert_allclose(clamp_rim(*tensors)[0].permute(1, 2, 0).numpy(), clamped(maps, mask), atol=1e-5)
