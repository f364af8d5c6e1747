"""Muon for convolutions with a norm, Adam for everything else."""

import pytest
import torch

from relight.learning.networks import build
from relight.learning.optimizers import Muon, make_optimizers


@pytest.mark.parametrize("name", ["ours", "unet"])
@pytest.mark.slow
def test_muon_has_the_weights_whose_scale_has_no_effect(model, schedule, name):
    torch.manual_seed(0)
    network = build(model(name=name, dropout=0.0), 64).double()
    optimizers = make_optimizers(network, schedule(optimizer="muon"))
    adam, muon = ([p for group in optimizers[name].param_groups for p in group["params"]] for name in ("adam", "muon"))
    assert sorted(map(id, [*adam, *muon])) == sorted(map(id, network.parameters())), "each parameter once"
    image, mask = torch.rand(4, 3, 64, 64).double(), torch.ones(4, 1, 64, 64).double()

    def changes(weights) -> list[bool]:
        """For each weight: whether outputs change when it is doubled."""
        found = []
        for weight in weights:
            before = network(image, mask)
            weight.data *= 2
            found.append(any((value - before[key]).abs().max() > 1e-3 for key, value in network(image, mask).items()))
            weight.data /= 2
        return found

    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.eps = 1e-12
    assert not any(changes(muon)) and len(muon) > 5 and all(changes(p for p in adam if p.ndim == 4))
    assert list(make_optimizers(network, schedule())) == ["adam"]


@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_steps_are_those_of_torch_muon(layout):
    """Three steps with momentum; torch's computes in bfloat16, so they agree to its eight bits only."""
    generator = torch.Generator().manual_seed(7)
    ours = torch.randn(16, 5, 4, 2, generator=generator)
    theirs = ours.flatten(1).clone().requires_grad_()
    ours = ours.to(memory_format=layout).requires_grad_()
    first, second = Muon([ours]), torch.optim.Muon([theirs], lr=0.01, weight_decay=0, adjust_lr_fn="match_rms_adamw")
    first.param_groups[0]["lr"] = 0.01
    before = theirs.detach().clone()
    for _ in range(3):
        gradient = torch.randn(16, 5, 4, 2, generator=generator)
        ours.grad, theirs.grad = gradient.to(memory_format=layout), gradient.flatten(1)
        first.step()
        second.step()
    difference, moved = (ours.flatten(1) - theirs).norm(), (theirs - before).norm()
    assert difference < 0.03 * moved
