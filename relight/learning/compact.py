"""Compact maps: the in-mask pixels of each image row by row, (B,P,C), padded with zeros to P.

Total variation and other differences between neighbours need to know where a pixel's neighbours stand in these rows.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

MULTIPLE = 64  # P is a multiple of it


@dataclass(frozen=True, kw_only=True)
class Places:
    """Where the pixels of compact maps stand in their images.

    pixel (B*P,) index of each pixel among the B*S*S, padding at a pixel outside the mask; inside (B,P,1) 1 for pixels,
    0 for padding; interior (B,P,1) 1 where all four neighbours are in the mask: the right one is the next in the row;
    below (B*P,) index of the pixel below each interior pixel among the B*P, else its own.
    """

    pixel: Tensor
    inside: Tensor
    interior: Tensor
    below: Tensor

    def take(self, dense: Tensor) -> Tensor:
        """The in-mask pixels (B,P,C), float32, of a dense map (B,C,S,S); no copy of the rest when channels_last."""
        rows = dense.permute(0, 2, 3, 1).reshape(-1, dense.shape[1])
        # Pixels are distinct, so the gradient of this gather adds to each place once, in no order: it is deterministic.
        return rows.index_select(0, self.pixel).float().view(len(dense), -1, dense.shape[1]) * self.inside


def compact(mask: Tensor) -> Places:
    """The places of the pixels of masks (B,1,S,S) bool; each image needs a pixel outside its mask."""
    batch, size = len(mask), mask.shape[-1]
    padded = torch.nn.functional.pad(mask[:, 0], (1, 1, 1, 1))
    eroded = mask[:, 0] & padded[:, :-2, 1:-1] & padded[:, 2:, 1:-1] & padded[:, 1:-1, :-2] & padded[:, 1:-1, 2:]
    flat, eroded = mask.flatten(1), eroded.flatten(1)
    most = -(-int(flat.sum(1).max()) // MULTIPLE) * MULTIPLE
    place = flat.cumsum(1) - 1
    image, at = flat.nonzero(as_tuple=True)
    slot = place[image, at]
    pixel = (~flat).int().argmax(1)[:, None].repeat(1, most)
    pixel[image, slot] = at
    below = torch.arange(most, device=mask.device).repeat(batch, 1)
    under = place[image, (at + size).clamp_max(size * size - 1)]
    inner = eroded[image, at]
    below[image, slot] = torch.where(inner, under, slot)
    inside, interior = (torch.zeros(batch, most, 1, device=mask.device) for _ in range(2))
    inside[image, slot] = 1
    interior[image, slot, 0] = inner.float()
    start = torch.arange(batch, device=mask.device)[:, None]
    return Places(
        pixel=(pixel + start * size * size).flatten(),
        inside=inside,
        interior=interior,
        below=(below + start * most).flatten(),
    )
