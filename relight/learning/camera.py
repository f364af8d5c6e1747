"""From light in the scene to the pixels that a network sees: the colour models `paper` and `photo`."""

import torch
from torch import Tensor

BRIGHTEST = 10.0  # shadings are clipped to [0, 10], as the authors do


def decode(coded: Tensor) -> Tensor:
    """sRGB in [0,1] -> linear in [0,1] (IEC 61966-2-1)."""
    return torch.where(coded <= 0.04045, coded / 12.92, ((coded.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def encode(linear: Tensor) -> Tensor:
    """Linear in [0,1] -> sRGB in [0,1]."""
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


def quantised(linear: Tensor) -> Tensor:
    """Linear values as the sRGB codes 0..255 of an 8-bit image, uint8."""
    return (encode(linear.clamp(0, 1)) * 255).round().to(torch.uint8)


LINEAR = decode(torch.arange(256) / 255)  # linear value of each code


def shade(transport: Tensor, light: Tensor) -> Tensor:
    """Shading T.L (..., P, 3) of transport (..., P, K) under light (..., K, 3), clipped to [0, 10]."""
    return (transport @ light).clamp(0, BRIGHTEST)


def photograph(relit: Tensor, color: str) -> Tensor:
    """What a network sees of the relit values albedo * shading.

    `paper`: just these, unclipped, as the authors do. `photo`: as a camera leaves them: clipped to [0,1], stored in
    8 bits of sRGB, and decoded. The exposure is part of the light, which is scaled to a reference brightness.
    """
    return relit if color == "paper" else LINEAR.to(relit.device)[quantised(relit).int()]
