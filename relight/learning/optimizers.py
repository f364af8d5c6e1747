"""The optimisers: Adam, as in the paper, or Muon for convolutions with a norm, and Adam for the other weights."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from relight.config import Train
from relight.learning.networks import NORMS

# Learning rate of Muon over that of Adam. Muon spreads each step over all directions of a matrix, so it takes steps of
# a larger RMS than Adam; docs/training.md has the measurement.
MUON_LR = 5.0


class ConvolutionMuon(torch.optim.Muon):
    """Muon (Jordan et al. 2024) for the weights (A,B,h,w) of convolutions, as matrices (A,Bhw).

    Its group has the learning rate `factor` times that of Adam, for steps of the RMS of Adam's.

    Args:
        weights: (A,B,h,w) each, contiguous or channels last.
    """

    def __init__(self, weights: list[Tensor]):
        self.weights = weights
        matrices = [as_matrix(weight.detach(), weight) for weight in weights]
        groups = [{"params": matrices, "factor": MUON_LR}]
        super().__init__(groups, weight_decay=0.0, adjust_lr_fn="match_rms_adamw")

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Resets the gradients of the weights."""
        for weight in self.weights:
            weight.grad = None

    def step(self, closure: Callable[[], float] | None = None) -> float | None:  # type: ignore[override]  # overloaded
        """Updates the weights in place by their gradients."""
        for matrix, weight in zip(self.param_groups[0]["params"], self.weights):
            matrix.grad = None if weight.grad is None else as_matrix(weight.grad, weight)
        return super().step(closure)  # type: ignore[no-untyped-call]  # torch's has no hints


def as_matrix(values: Tensor, weight: Tensor) -> Tensor:
    """Returns `values` (A,B,h,w) as a matrix (A,Bhw), with columns in the memory order of `weight` to avoid a copy."""
    return (values if weight.is_contiguous() else values.permute(0, 2, 3, 1)).flatten(1)


def normalised_weights(network: nn.Module) -> list[Tensor]:
    """Returns the trainable weights of all convolutions that a norm follows.

    Their scale has no effect on the output, so they may grow under Muon's steps of constant size.
    """
    pairs = (part for part in network.modules() if isinstance(part, nn.Sequential) and len(part) > 1)
    weights: list[Any] = [part[0].weight for part in pairs if isinstance(part[1], tuple(NORMS.values()))]
    return [weight for weight in weights if weight.requires_grad]


def make_optimizers(network: nn.Module, train: Train) -> dict[str, torch.optim.Optimizer]:
    """Returns the optimisers by name; together they update every trainable parameter."""
    muon = normalised_weights(network) if train.optimizer == "muon" else []
    chosen = {id(weight) for weight in muon}
    adam = [p for p in network.parameters() if p.requires_grad and id(p) not in chosen]
    betas = (train.beta1, train.beta2)
    found: dict[str, torch.optim.Optimizer] = {"adam": torch.optim.Adam(adam, train.lr, betas, fused=True)}
    if muon:
        found["muon"] = ConvolutionMuon(muon)
    return found
