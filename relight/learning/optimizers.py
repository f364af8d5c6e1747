"""The optimisers: Adam, as in the paper, or Muon for convolutions with a norm, and Adam for the other weights."""

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from relight.learning.networks import NORMS
from relight.settings import Train

BETA2 = 0.999  # decay of Adam's mean of squared gradients
# Learning rate of Muon over that of Adam. Muon spreads each step over all directions of a matrix, so it takes steps of
# a larger RMS than Adam; docs/lab/tried.md has the measurement.
MUON_LR = 5.0
MOMENTUM = 0.95  # decay of Muon's mean of gradients
RMS = 0.2  # root mean square of Muon's steps over its learning rate, about that of Adam's (Liu et al. 2025)
# Coefficients of the quintic x -> a x + b x^3 + c x^5 that moves singular values toward 1 (Jordan et al. 2024).
QUINTIC = (3.4445, -4.7750, 2.0315)
ITERATIONS = 5


class Muon(torch.optim.Optimizer):
    """Muon (Jordan et al. 2024) for the weights (A,B,h,w) of convolutions, as matrices (A,Bhw).

    A step is the orthogonal matrix nearest to the mean of the gradients (Nesterov's momentum), scaled to an RMS of
    0.2 times the learning rate. Its group has the learning rate `factor` times that of Adam.

    `torch.optim.Muon` computes in bfloat16, which is 50 times slower than float32 on a CPU without instructions for
    it. This one computes in float32 everywhere, so what a training learns does not depend on that.

    Args:
        weights: (A,B,h,w) each, contiguous or channels last.
    """

    def __init__(self, weights: list[Tensor]):
        """Starts with the learning rate 0; a schedule sets `lr`, which is multiplied by `factor`."""
        super().__init__([{"params": weights, "factor": MUON_LR}], {"lr": 0.0})

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]  # overloaded
        """Updates the weights in place by their gradients."""
        for group in self.param_groups:
            for weight in (weight for weight in group["params"] if weight.grad is not None):
                if not (state := self.state[weight]):
                    state["momentum"] = torch.zeros_like(weight)
                mean = state["momentum"].lerp_(weight.grad, 1 - MOMENTUM)
                matrix = as_matrix(weight.grad.lerp(mean, MOMENTUM), weight)
                scale = RMS * math.sqrt(max(matrix.shape))
                as_matrix(weight, weight).sub_(orthogonalised(matrix), alpha=group["lr"] * scale)


def orthogonalised(matrix: Tensor) -> Tensor:
    """Returns about the nearest orthogonal matrix: the same singular vectors, singular values of about 1.

    Five Newton-Schulz iterations X -> (a + b G + c G^2) X with G = X X^T, as in Jordan et al. 2024. Their product is a
    polynomial P of the first G, so they are done on G alone, and P X is one product at the end. For the wide matrices
    of 3x3 convolutions this takes 35 A^3 multiplications and not 95.

    Args:
        matrix: (A,B) float32.

    Returns:
        (A,B), with singular values between 0.6 and 1.3 where those of `matrix` exceed 0.002 of its Frobenius norm.
    """
    if matrix.shape[0] > matrix.shape[1]:
        return orthogonalised(matrix.mT).mT
    a, b, c = QUINTIC
    x = matrix / matrix.norm().clamp_min(1e-7)
    gram = x @ x.mT
    product = None
    for iteration in range(ITERATIONS):
        factor = torch.addmm(gram, gram, gram, beta=b, alpha=c)
        factor.diagonal().add_(a)
        product = factor if product is None else factor @ product
        if iteration < ITERATIONS - 1:
            gram = factor @ gram @ factor
    return product @ x


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
    betas = (train.beta1, BETA2)
    optimizers: dict[str, torch.optim.Optimizer] = {"adam": torch.optim.Adam(adam, train.lr, betas, fused=True)}
    if muon:
        optimizers["muon"] = Muon(muon)
    return optimizers
