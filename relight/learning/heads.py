"""From the features of the bottleneck, and from the inferred maps, to the light."""

from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from relight.learning.blocks import normalised

SLOPE = 0.2  # of the leaky ReLUs


class StridedHead(nn.Module):
    """The paper's light head: four strided convolutions down to one pixel.

    At 1024 px they go 16 -> 8 -> 4 -> 2 -> 1. From a smaller bottleneck the maps reach one pixel early and the rest
    are 1x1 convolutions; from a larger one the last map is averaged.
    """

    def __init__(self, inputs: int, channels: list[int], outputs: int, side: int, norm: str):
        super().__init__()
        self.layers = nn.ModuleList()
        for width in channels:
            kernel, side = ((4, 2, 1), side // 2) if side > 1 else ((1, 1, 0), 1)
            self.layers.append(normalised(nn.Conv2d, inputs, width, kernel, side, norm))
            inputs = width
        self.last = nn.Conv2d(inputs, outputs, *((4, 2, 1) if side > 1 else (1, 1, 0)))

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        for layer in self.layers:
            x = F.leaky_relu(layer(x), SLOPE)
        return self.last(x).mean((2, 3))


class PooledHead(nn.Module):
    """A light head that averages its features, of 1/stride of the image's size, over the figure only."""

    def __init__(self, inputs: int, channels: list[int], outputs: int, stride: int):
        super().__init__()
        self.stride = stride
        sizes = [inputs, *channels]
        self.layers = nn.ModuleList(nn.Conv2d(a, b, 1) for a, b in pairwise(sizes))
        self.last = nn.Conv2d(sizes[-1], outputs, 1)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        share = F.avg_pool2d(mask, self.stride)
        x = F.leaky_relu(self.layers[0](x), SLOPE)  # before the pool, so that it can choose where to look
        x = (x * share).sum((2, 3), keepdim=True) / share.sum((2, 3), keepdim=True).clamp_min(1e-6)
        for layer in self.layers[1:]:
            x = F.leaky_relu(layer(x), SLOPE)
        return self.last(x).flatten(1)


class Refinement(nn.Module):
    """Moves a light toward the one that, with the inferred maps, explains the image (not in the paper).

    For each colour channel the refined L minimises mean_p (a_p T_p.L - I_p)^2 + sum_k w_k (L_k - L0_k)^2 over the
    pixels p of the figure, in closed form: a inferred albedo, T inferred transport, I the image, L0 the head's light.
    The weights w of trust in the head are learned. No gradient goes to the maps: what is wrong with them must not be
    mended by what the light needs.
    """

    SIDE = 64  # maps are thinned out to about so many pixels a side: hundreds of equations for nine unknowns

    def __init__(self, coefficients: int):
        super().__init__()
        self.trust = nn.Parameter(torch.full((coefficients,), -4.0))  # ln w

    def forward(self, light: Tensor, albedo: Tensor, transport: Tensor, image: Tensor, mask: Tensor) -> Tensor:
        """light (B,K,3), albedo (B,3,S,S), transport (B,K,S,S), image (B,3,S,S), mask (B,1,S,S) -> light (B,K,3)."""
        with torch.autocast(light.device.type, enabled=False):
            every = max(1, image.shape[-1] // self.SIDE)
            albedo, transport, image, mask = (
                x[..., ::every, ::every].flatten(2).float().detach() for x in (albedo, transport, image, mask)
            )
            transport = transport * mask
            weighted = (albedo**2)[:, :, None] * transport[:, None]  # (B,3,K,P)
            pixels = mask.sum((1, 2)).clamp_min(1)[:, None, None]
            trust = self.trust.exp()
            left = weighted @ transport[:, None].mT / pixels[..., None] + torch.diag(trust)
            right = (albedo * image) @ transport.mT / pixels + trust * light.float().mT
            return torch.linalg.solve(left, right).mT
