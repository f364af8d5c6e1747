"""Validation: the losses on a few fixed pairs of the test, and a picture of what is inferred of them beside the truth.

Nothing is chosen by them: a training takes its number of steps, whatever they say.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from relight.config import NO_AUGMENTATION, Loss
from relight.learning.augment import augmented
from relight.learning.camera import encode, shade
from relight.learning.data import RelitSet, read_split
from relight.learning.losses import losses, weighted_sum, weights
from relight.learning.networks import with_transport
from relight.sh import order_of

PAIRS = 4  # at most
LARGEST = 192  # pixels of a cell's height
GAP, PAPER = 4, 0.97


class Validation:
    """Some pairs of a test figure and a test light, spread over both, as a network under training is shown them.

    Without test figures or test lights there are none, and `pairs` is 0.
    """

    def __init__(self, data: RelitSet, split: Path, loss: Loss, size: int):
        figures = data.figures(read_split(split).get("test", []))
        lights = np.flatnonzero(data.light_split == "test")
        self.loss, self.color = loss, data.color
        self.pairs = min(PAIRS, max(len(figures), len(lights))) if len(figures) and len(lights) else 0
        if self.pairs:
            spread = np.linspace(0, 1, self.pairs)
            chosen = [part[np.round(spread * (len(part) - 1)).astype(int)] for part in (figures, lights)]
            batch = data.batch(*chosen)
            batch = replace(batch, scope=float(batch.inside.sum()))
            self.batch = augmented(batch, NO_AUGMENTATION, [np.random.default_rng(0) for _ in range(self.pairs)], size)

    @torch.inference_mode()
    def __call__(self, network: nn.Module, drawn: bool = False) -> tuple[dict[str, float], np.ndarray | None]:
        """The losses of `network`, which is left as it was; and a picture (H,W,3) uint8 if it is to be `drawn`."""
        if not self.pairs:
            return {}, None
        modes = [(part, part.training) for part in network.modules()]
        network.eval()
        try:
            outputs = network(self.batch.image, self.batch.mask)
        finally:
            for part, mode in modes:
                part.training = mode
        values = losses(outputs, self.batch, self.loss)
        weight = weights(self.loss, self.batch.size)
        values = {"loss": weighted_sum(values, weight), **values}
        return {name: float(value) for name, value in values.items()}, self.picture(outputs) if drawn else None

    def picture(self, outputs: dict[str, Tensor]) -> np.ndarray:
        """Two rows a pair, truth over inference: picture, albedo, shading, lit ball, relit by the next pair's light.

        What a network infers of the picture is albedo * shading. Pairs lie two by two.
        """
        from relight.lights import lit_ball

        batch = self.batch
        order = order_of(batch.light.shape[1])
        maps = with_transport({name: batch.take(dense) for name, dense in outputs.items() if name != "light"}, order)
        white = batch.shading.flatten(1).amax(1).clamp_min(1.0)
        rows = []
        for albedo, transport, light, shading in (
            (batch.albedo, batch.transport, batch.light, batch.shading),
            (maps["albedo"], maps["transport"], outputs["light"].float(), None),
        ):
            shading = shade(transport, light) if shading is None else shading
            relit = albedo * shade(transport, batch.light.roll(-1, 0))
            cells = [albedo * shading, albedo, shading / white[:, None, None], relit]
            rows.append((self._cells([cell * batch.inside for cell in cells]), light.cpu().numpy()))
        height, width = rows[0][0][0].shape[1:3]
        blocks = []
        for pair in range(self.pairs):
            lines = []
            for (*panels, last), coefficients in rows:
                lit = lit_ball(coefficients[pair], min(height, width))
                cell = np.full((height, width, 3), PAPER, np.float32)
                top, left = (height - len(lit)) // 2, (width - len(lit)) // 2
                inside = cell[top : top + len(lit), left : left + len(lit)]
                inside[:] = lit[..., :3] * lit[..., 3:] + inside * (1 - lit[..., 3:])
                lines.append([*(panel[pair] for panel in panels), cell, last[pair]])
            blocks.append(joined([joined(line, 1) for line in lines], 0))
        if len(blocks) > 1 and len(blocks) % 2:
            blocks.append(np.full_like(blocks[0], PAPER))
        sheet = joined([joined(blocks[i : i + 2], 1, 4 * GAP) for i in range(0, len(blocks), 2)], 0, 4 * GAP)
        return np.round(np.clip(sheet, 0, 1) * 255).astype(np.uint8)

    def _cells(self, compact: list[Tensor]) -> list[np.ndarray]:
        """Compact maps (B,P,3) as pictures (B,h,w,3): display-coded, on paper, cut to the figures, no higher than
        LARGEST."""
        batch = self.batch
        rows, columns = (torch.nonzero(batch.mask.amax((0, 1, axis)) > 0).flatten() for axis in (3, 2))
        window = (..., slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        shrink = -(-int(rows[-1] - rows[0] + 1) // LARGEST)
        found = []
        for values in compact:
            values = values.clamp(0, 1)
            dense = batch.put(encode(values) if self.color == "photo" else values)
            cell = (dense + PAPER * (1 - batch.mask))[window]
            cell = F.avg_pool2d(cell, shrink) if shrink > 1 else cell
            found.append(cell.permute(0, 2, 3, 1).cpu().numpy())
        return found


def joined(parts: list[np.ndarray], axis: int, gap: int = GAP) -> np.ndarray:
    """Pictures (h,w,3) side by side along `axis`, `gap` pixels of paper between them."""
    shape = list(parts[0].shape)
    shape[axis] = gap
    space = np.full(shape, PAPER, np.float32)
    return np.concatenate([part for picture in parts for part in (picture, space)][:-1], axis)
