"""Converts radiance to the input of a network, by the color models `paper` and `photo`."""

import torch
from torch import Tensor

MAX_SHADING = 10.0  # as the authors clip


def decode(coded: Tensor) -> Tensor:
    """Returns linear values of sRGB codes, both in [0,1] (IEC 61966-2-1)."""
    return torch.where(coded <= 0.04045, coded / 12.92, ((coded.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def encode(linear: Tensor) -> Tensor:
    """Returns sRGB codes of linear values, both in [0,1] (IEC 61966-2-1)."""
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


def quantised(linear: Tensor) -> Tensor:
    """Returns the 8-bit sRGB codes (uint8) of linear values, clipped to [0,1]."""
    return (encode(linear.clamp(0, 1)) * 255).round().to(torch.uint8)


LINEAR = decode(torch.arange(256) / 255)  # linear value of each code


def shade(transport: Tensor, light: Tensor) -> Tensor:
    """Returns the shading T.L (..., P, 3) of transport (..., P, K) under light (..., K, 3), clipped to [0, 10]."""
    return (transport @ light).clamp(0, MAX_SHADING)


def photograph(relit: Tensor, color: str) -> Tensor:
    """Returns the network input for relit radiance.

    Args:
        relit: albedo * shading, linear.
        color: `paper` returns the values unchanged, as the authors do; `photo` records them as a camera does: clipped
            to [0,1], stored as 8-bit sRGB, and decoded.
    """
    return relit if color == "paper" else LINEAR.to(relit.device)[quantised(relit).int()]
