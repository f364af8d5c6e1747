"""What the networks are made of: norms, residual block, decoder.

A map of one pixel is never normalised (its own mean is all it has): there the convolution keeps its bias instead.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

DROPPED = 3  # deconvolutions of each decoder that drop features


class InstanceNorm(nn.Module):
    """Normalises each channel of each image by its own mean and variance, then applies a scale and an offset."""

    def __init__(self, channels: int):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        if len(x) == 1:  # the same thing, and these kernels keep channels_last
            return F.batch_norm(x, None, None, self.weight, self.bias, training=True)
        return F.group_norm(x, x.shape[1], self.weight, self.bias)  # twice as fast as instance_norm in channels_last


NORMS = {"instance": InstanceNorm, "batch": nn.BatchNorm2d}


def normalised(conv: type, inputs: int, outputs: int, kernel: tuple[int, int, int], side: int, norm: str) -> nn.Module:
    """A (de)convolution of (kernel, stride, padding) to maps of `side` pixels, and its norm where there is one."""
    if side == 1:
        return conv(inputs, outputs, *kernel)
    return nn.Sequential(conv(inputs, outputs, *kernel, bias=False), NORMS[norm](outputs))


class Residual(nn.Module):
    """x + norm(conv(relu(norm(conv(x))))), nothing after the sum."""

    def __init__(self, channels: int, side: int, norm: str):
        super().__init__()
        self.first = normalised(nn.Conv2d, channels, channels, (3, 1, 1), side, norm)
        self.second = normalised(nn.Conv2d, channels, channels, (3, 1, 1), side, norm)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.second(F.relu(self.first(x)))


class Decoder(nn.Module):
    """A residual block and six deconvolutions to a map of `outputs` channels at full size."""

    def __init__(self, encoder: list[int], channels: list[int], outputs: int, side: int, norm: str, dropout: float):
        super().__init__()
        self.dropout = dropout
        self.residual = Residual(encoder[-1], side, norm)
        self.up = nn.ModuleList()
        inputs = encoder[-1]
        for width, skip in zip(channels, reversed(encoder[:-1])):
            side *= 2
            self.up.append(normalised(nn.ConvTranspose2d, inputs, width, (4, 2, 1), side, norm))
            inputs = width + skip
        self.last = nn.ConvTranspose2d(inputs, outputs, 4, 2, 1)

    def forward(self, features: list[Tensor]) -> tuple[Tensor, Tensor]:
        """Encoder features, finest first -> (residual output (B,C,s,s), map (B,outputs,S,S))."""
        residual = x = self.residual(features[-1])
        for level, (up, skip) in enumerate(zip(self.up, reversed(features[:-1]))):
            x = up(x)
            if level < DROPPED:
                x = F.dropout(x, self.dropout, self.training)
            x = torch.cat([F.relu(x), skip], 1)
        return residual, self.last(x)
