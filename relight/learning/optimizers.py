"""The optimisers: Adam, as in the paper, or Muon for hidden convolutions, with Adam for the other weights."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from relight.config import Train

# Learning rate of Muon over that of Adam. Muon spreads each step over all directions of a matrix, so it takes steps of
# a larger RMS than Adam; docs/training.md has the measurement.
MUON_LR = 5.0
PICTURE = 4  # channels of a picture and its mask


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


def is_hidden(name: str, parameter: Tensor) -> bool:
    """Returns whether a parameter of a network belongs to a convolution between others.

    Not hidden are the layers that see the picture and its mask, and those that write an output, which are named `last`.
    """
    return parameter.ndim == 4 and parameter.shape[1] > PICTURE and not name.endswith("last.weight")


def make_optimizers(network: nn.Module, train: Train) -> dict[str, torch.optim.Optimizer]:
    """Returns the optimisers by name; together they update every trainable parameter."""
    muon: list[Tensor] = []
    adam: list[Tensor] = []
    for name, parameter in network.named_parameters():
        if parameter.requires_grad:
            chosen = muon if train.optimizer == "muon" and is_hidden(name, parameter) else adam
            chosen.append(parameter)
    common: dict[str, Any] = {"lr": train.lr, "betas": (train.beta1, train.beta2), "fused": True}
    found: dict[str, torch.optim.Optimizer] = {"adam": torch.optim.Adam(adam, **common)}
    if muon:
        found["muon"] = ConvolutionMuon(muon)
    return found
