"""Muon for the hidden convolutions, Adam for everything else."""

import pytest
import torch

from relight.learning.networks import build
from relight.learning.optimizers import MUON_LR, ConvolutionMuon, make_optimizers


@pytest.mark.parametrize("name", ["ours", "sfsnet_ao", "unet"])
def test_each_parameter_has_one_optimiser(model, schedule, name):
    network = build(model(name=name, refine=True), 64)
    optimizers = make_optimizers(network, schedule(optimizer="muon"))
    adam = [p for group in optimizers["adam"].param_groups for p in group["params"]]
    chosen = {p.data_ptr() for p in [*adam, *optimizers["muon"].weights]}
    assert chosen == {p.data_ptr() for p in network.parameters()}
    assert len(chosen) == len(adam) + len(optimizers["muon"].weights)
    names = {p.data_ptr(): name for name, p in network.named_parameters()}
    muon = {names[weight.data_ptr()] for weight in optimizers["muon"].weights}
    rest = {n for n, p in network.named_parameters() if p.ndim == 4} - muon
    last = {n for n in names.values() if n.endswith("last.weight")}
    first = next(n for n in names.values() if n.startswith("encoder.0"))
    assert len(last) > 1 and rest == {*last, first}
    assert list(make_optimizers(network, schedule())) == ["adam"]


@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_a_first_step_is_the_orthogonal_factor_of_the_gradient(layout):
    """The step of the exact polar factor U V^T, which Newton-Schulz approximates, by a singular value decomposition."""
    generator = torch.Generator().manual_seed(3)
    weight = torch.randn(12, 5, 3, 3, generator=generator).to(memory_format=layout).requires_grad_()
    gradient = torch.randn(12, 5, 3, 3, generator=generator) * torch.arange(1, 13)[:, None, None, None]
    weight.grad = gradient.to(memory_format=layout)
    before, optimizer = weight.detach().clone(), ConvolutionMuon([weight])
    optimizer.param_groups[0]["lr"] = MUON_LR * 1e-3
    optimizer.step()
    step = (before - weight.detach()).flatten(1)
    left, _, right = torch.linalg.svd(gradient.flatten(1), full_matrices=False)
    exact = left @ right
    assert (step * exact).sum() / step.norm() / exact.norm() > 0.97
    assert step.square().mean().sqrt().item() == pytest.approx(0.2 * MUON_LR * 1e-3, rel=0.2)
    optimizer.zero_grad()
    assert weight.grad is None
