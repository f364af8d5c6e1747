"""The networks against the table of the method: channels, sizes, parameters, norms, initial weights."""

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional as F
from torch.utils.flop_counter import FlopCounterMode

from relight.core.errors import UserError
from relight.learning.networks import Network, PooledHead, Refinement, build, constrain_albedo, widened

HEAD = {"ours": "strided", "unet": "pooled"}


@pytest.mark.parametrize("name, decoders, millions, giga", [
    ("ours", {"transport": 9, "albedo": 3}, 72.06, 164.1),
    ("sfsnet", {"normal": 3, "albedo": 3}, 72.04, 160.8),
    ("sfsnet_ao", {"normal": 3, "ao": 1, "albedo": 3}, 99.05, 224.1),
])  # fmt: skip
def test_layers_of_the_paper_at_full_size(model, name, decoders, millions, giga):
    with torch.device("meta"):
        network = build(model(name=name, width=1.0, norm="instance"), 1024)
    maps = []  # (channels, side) that each convolution puts out
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            module.register_forward_hook(lambda _, __, output: maps.append(tuple(output.shape[1:3])))
    with FlopCounterMode(display=False) as flops:
        network(*(torch.empty(1, channels, 1024, 1024, device="meta") for channels in (3, 1)))
    encoder = [(64, 512), (128, 256), (256, 128), (512, 64), (512, 32), (512, 16)]
    decoder = [(512, 16), (512, 16), (512, 32), (512, 64), (256, 128), (128, 256), (64, 512)]
    both = [layer for outputs in decoders.values() for layer in (*decoder, (outputs, 1024))]
    assert maps == [*encoder, *both, (512, 8), (256, 4), (128, 2), (27, 1)]  # the light's at last
    assert network.light.layers[0][0].in_channels == 512 * (1 + len(decoders))
    assert sum(p.numel() for p in network.parameters()) / 1e6 == pytest.approx(millions, abs=0.01)
    assert flops.get_total_flops() / 2e9 == pytest.approx(giga, abs=0.1)


def test_dropout_acts_in_training_on_the_first_three_deconvolutions_only(model):
    torch.manual_seed(0)
    network, seen = build(model(dropout=0.999999), 64).train(), {}
    for level, block in enumerate(network.decoders["albedo"].up[1:] + [network.decoders["albedo"].last], 1):
        block.register_forward_pre_hook(lambda module, inputs, level=level: seen.update({level: inputs[0]}))
    network(torch.rand(2, 3, 64, 64), torch.ones(2, 1, 64, 64))
    own = {level: x[:, : network.decoders["albedo"].up[level - 1][0].out_channels] for level, x in seen.items()}
    assert [bool(own[level].abs().max() > 0) for level in (1, 2, 3, 4, 5)] == [False, False, False, True, True]


@pytest.mark.parametrize("size", [64, 192])
@pytest.mark.parametrize("norm", ["instance", "batch"])
@pytest.mark.parametrize("name", ["ours", "unet"])
def test_every_multiple_of_64_learns_from_every_part(model, name, size, norm):
    """A norm over one pixel would put out zeros and pass no gradient on: all weights must get one."""
    torch.manual_seed(1)
    network = build(model(name=name, norm=norm, order=3, light_head=HEAD[name]), size).train()
    outputs = network(torch.rand(2, 3, size, size), torch.ones(2, 1, size, size))
    shapes = {"transport": (2, 16, size, size), "albedo": (2, 3, size, size), "light": (2, 16, 3)}
    assert {name: tuple(value.shape) for name, value in outputs.items()} == shapes
    assert (outputs["light"][0] - outputs["light"][1]).abs().max() > 1e-6
    sum((value * torch.randn_like(value)).sum() for value in outputs.values()).backward()
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in network.parameters())


@pytest.mark.parametrize("size", [0, 32, 100, 1000])
def test_other_sizes_are_refused(model, size):
    with pytest.raises(UserError, match=f"{size} px.*multiple of 64"):
        build(model(), size)


def test_instance_norm_is_the_batch_norm_of_one_image(model):
    torch.manual_seed(2)
    one, other = (build(model(norm=norm, dropout=0.0), 128).train() for norm in ("instance", "batch"))
    for weight in one.parameters():
        if weight.ndim == 1:
            nn.init.normal_(weight, 1.0, 0.3)
    missing = other.load_state_dict(one.state_dict(), strict=False)
    assert not missing.unexpected_keys and all("running" in k or "tracked" in k for k in missing.missing_keys)
    image, mask = torch.rand(3, 3, 128, 128), (torch.rand(3, 1, 128, 128) > 0.3).float()
    together = one(image, mask)
    for i in range(3):
        alone, batch = one(image[i : i + 1], mask[i : i + 1]), other(image[i : i + 1], mask[i : i + 1])
        for key in together:
            torch.testing.assert_close(alone[key], batch[key], atol=1e-6, rtol=1e-5)
            torch.testing.assert_close(together[key][i : i + 1], batch[key], atol=2e-5, rtol=1e-4)


@pytest.mark.parametrize("name", ["ours", "unet"])
def test_the_background_is_not_seen_and_black_is_not_background(model, name):
    torch.manual_seed(3)
    network, mask = build(model(name=name, light_head=HEAD[name]), 64).eval(), torch.zeros(1, 1, 64, 64)
    mask[..., 16:48, 20:40] = 1
    image = torch.rand(1, 3, 64, 64)
    one, other = network(image, mask), network(image * mask + 7 * (1 - mask), mask)
    assert all(torch.equal(one[key], other[key]) for key in one)
    black = network(image * 0, mask)
    assert (black["light"] - network(image * 0, mask * 0)["light"]).abs().max() > 1e-6


@pytest.mark.parametrize("how, gradient", [("clip", [0, 1, 0]), ("straight_through", [1, 1, 1])])
def test_albedo_stays_in_range_and_its_gradient_is_as_said(how, gradient):
    x = torch.tensor([-0.5, 0.25, 1.5], requires_grad=True)
    y = constrain_albedo(x, how)
    assert y.tolist() == [0, 0.25, 1]
    y.sum().backward()
    assert x.grad.tolist() == gradient


def test_pooled_head_looks_at_the_figure_only():
    torch.manual_seed(6)
    head, mask = PooledHead(16, [32, 16, 8], 27, 16), torch.zeros(2, 1, 64, 64)
    mask[:, :, 16:48, 16:48] = 1
    x = torch.randn(2, 16, 4, 4)
    changed = x.clone()
    changed[:, :, 0] = 9
    assert torch.equal(head(x, mask), head(changed, mask))
    changed[:, :, 2, 2] = 9
    assert (head(x, mask) - head(changed, mask)).abs().max() > 1e-3 and head(x, mask * 0).isfinite().all()


@pytest.mark.parametrize("size", [64, 256])
def test_refined_light_solves_the_weighted_least_squares(size):
    """Twin: numpy's least squares on all equations stacked one under the other; unknowns are (channel, coefficient)."""
    generator = torch.Generator().manual_seed(7)
    albedo, transport, image = (torch.rand(2, c, size, size, generator=generator) for c in (3, 9, 3))
    mask = (torch.rand(2, 1, size, size, generator=generator) > 0.5).float()
    light, refinement = torch.randn(2, 9, 3, generator=generator), Refinement(9, 0.5).eval()
    light[1] = 0.2 + 0.02 * light[1]  # its factor is about 1, that of the other at a bound
    nn.init.normal_(refinement.trust, -3, 1, generator=generator)
    nn.init.normal_(refinement.coupling, 0, 0.3, generator=generator)
    refined = refinement(light, albedo, transport, image * mask, mask)
    every = max(1, size // Refinement.SIDE)
    trust = refinement.trust.detach().double().exp().sqrt()[:, None, None]
    roots = trust * (torch.eye(3) + refinement.coupling.detach())
    for b in range(2):
        rows, columns = np.nonzero(mask[b, 0, ::every, ::every].numpy())
        at = (b, slice(None), rows * every, columns * every)
        shaded = albedo[at] * torch.einsum("kp,kc->cp", transport[at], light[b])
        factor = np.linalg.lstsq(shaded.reshape(-1, 1), image[at].flatten(), rcond=None)[0].item()
        head = light[b].double().numpy() * np.clip(factor, 0.25, 4) ** 0.5
        equations, values = [], []
        for c in range(3):
            block = np.zeros((len(rows), 3, 9))
            block[:, c] = (albedo[at][c] * transport[at]).double().numpy().T / len(rows) ** 0.5
            equations.append(block.reshape(-1, 27))
            values.append(image[at][c].double().numpy() / len(rows) ** 0.5)
        for k in range(9):  # three equations: C_k^T L_k = C_k^T s L0_k
            block = np.zeros((3, 3, 9))
            block[:, :, k] = roots[k].double().numpy().T
            equations.append(block.reshape(-1, 27))
            values.append(block[:, :, k] @ head[k])
        expected = np.linalg.lstsq(np.concatenate(equations), np.concatenate(values), rcond=None)[0]
        np.testing.assert_allclose(refined[b].T.flatten().detach().numpy(), expected, rtol=2e-3, atol=2e-3)
    trained = refinement.train()(light, albedo, transport, image * mask, mask)
    refinement.rescale = 0.0
    assert torch.equal(trained, refinement.eval()(light, albedo, transport, image * mask, mask))


@pytest.mark.parametrize("name", ["ours", "sfsnet_ao"])
def test_refinement_teaches_the_head_and_its_trust_but_not_the_maps(model, name):
    torch.manual_seed(8)
    network = build(model(name=name, refine=True, light_head="pooled"), 64).train()
    network(torch.rand(2, 3, 64, 64), torch.ones(2, 1, 64, 64))["light"].sum().backward()
    assert network.refinement.trust.grad.abs().min() > 0 and network.refinement.coupling.grad.abs().min() > 0
    assert network.light.last.weight.grad.abs().max() > 0
    assert all(decoder.last.weight.grad is None for decoder in network.decoders.values())
    empty = network(torch.rand(2, 3, 64, 64), torch.zeros(2, 1, 64, 64))["light"]
    assert empty.isfinite().all(), "without a single pixel the head's own light stands"


def test_a_picture_is_balanced_by_the_color_of_its_light_before_it_is_seen(model):
    """A network that takes the mean of what it sees for the light, and what it sees for albedo."""

    class Eye(Network):
        refinement = None

        def infer(self, seen, mask):
            albedo = (seen + mask) / 2
            light = F.pad((albedo.sum((2, 3)) / mask.sum((2, 3)))[:, None], (0, 0, 0, 8)).flatten(1)
            return {"albedo": albedo, "transport": mask.expand(-1, 9, -1, -1)}, light

    network, mask = Eye(model(rebalance=0.5), 128), torch.zeros(2, 1, 128, 128)
    mask[..., 16:96, 32:64] = 1
    mean = torch.tensor([[0.4, 0.2, 0.1], [0.001, 0.05, 0.3]])
    image = mask * mean[..., None, None].expand(-1, -1, 128, 128)
    color = (mean / (mean @ torch.tensor([0.2126, 0.7152, 0.0722]))[:, None]).clamp(0.25, 4) ** 0.5
    outputs = network.eval()(image, mask)
    np.testing.assert_allclose(outputs["albedo"][..., 50, 50], mean / color, rtol=1e-4)
    np.testing.assert_allclose(outputs["light"][:, 0], mean, rtol=1e-4)
    assert torch.equal(network.train()(image, mask)["albedo"], network.look(image, mask)["albedo"])


def test_shape_from_the_mask_alone(model):
    torch.manual_seed(9)
    network, mask = build(model(sees="mask"), 64).eval(), torch.zeros(2, 1, 64, 64)
    mask[0, :, 16:48, 16:48] = mask[1, :, 8:56, 24:40] = 1
    one, other = (network(torch.rand(2, 3, 64, 64), mask) for _ in range(2))
    assert torch.equal(one["transport"], other["transport"])
    assert (one["transport"][0] - one["transport"][1]).abs().max() > 1e-6


@pytest.mark.parametrize("seed", range(2))
def test_the_unet_starts_alive(model, seed):
    """Every unit of the last hidden layer sees something, and little of the albedo is clipped; a dark image."""
    torch.manual_seed(seed)
    network, active = build(model(name="unet", light_head="pooled", width=0.25), 128), []
    network.sharpen.register_forward_hook(lambda module, inputs, output: active.append((output > 0).float()))
    with torch.no_grad():
        albedo = network(0.4 * torch.rand(2, 3, 128, 128), torch.ones(2, 1, 128, 128))["albedo"]
    assert active[0].mean((0, 2, 3)).min() > 0.01 and ((albedo > 0) & (albedo < 1)).float().mean() > 0.9


def test_a_unet_of_a_lower_order_goes_on_as_it_is_and_learns_the_further_bands(model):
    torch.manual_seed(0)
    options = {"name": "unet", "light_head": "pooled", "refine": True, "width": 0.1}
    narrow, wide = (build(model(order=order, **options), 64) for order in (2, 4))
    for value in narrow.parameters():
        torch.nn.init.normal_(value, std=0.1)
    wide.load_state_dict(widened(narrow.state_dict(), wide))
    image, mask = torch.rand(2, 3, 64, 64), torch.ones(2, 1, 64, 64)
    before, after = narrow.eval()(image, mask), wide.eval()(image, mask)
    for name, value in before.items():
        torch.testing.assert_close(after[name][:, : value.shape[1]], value, rtol=1e-3, atol=1e-4)
    assert not after["transport"][:, 9:].any() and not after["light"][:, 9:].any()
    (after["transport"][:, 9:].sum() + after["light"][:, 9:].sum()).backward()
    assert all(row.any() for row in (*wide.last.weight.grad[9:25], *wide.light.last.weight.grad[27:]))
