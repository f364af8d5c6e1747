"""Validation: losses on a few fixed pairs that are left out of the training, and a picture of predictions beside them.

The training neither stops early nor selects a checkpoint by them. The best of several trainings is chosen by the loss.
"""

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from relight.core.srgb import to_bytes
from relight.learning.augment import augment_batch
from relight.learning.color import encode, shade
from relight.learning.data import RelitSet, read_split
from relight.learning.losses import Comparison, losses
from relight.maps.square import extent
from relight.settings import NO_AUGMENTATION, Loss

MAX_PAIRS = 8
MAX_DRAWN = 4  # pairs in the picture
MAX_HEIGHT = 192  # pixels, of a cell
GAP = 4  # pixels between cells
BACKGROUND = 0.97  # grey value


class Validation:
    """Pairs of a validation figure and a validation light, evenly spread over both, relit as for the training.

    Attributes:
        pairs: their number; 0 without validation figures or lights.
        batch: the pairs; unset without any.
        loss: weights and reduction.
        color: color model.
    """

    def __init__(self, data: RelitSet, split: Path, loss: Loss, size: int):
        """Draws the pairs, as images of `size` pixels a side."""
        figures = data.figures(read_split(split).get("validation", []))
        lights = np.flatnonzero(data.light_split == "validation")
        self.loss, self.color = loss, data.color
        self.pairs = min(MAX_PAIRS, max(len(figures), len(lights))) if len(figures) and len(lights) else 0
        if self.pairs:
            spread = np.linspace(0, 1, self.pairs)
            chosen = [part[np.round(spread * (len(part) - 1)).astype(int)] for part in (figures, lights)]
            generators = [np.random.default_rng(0) for _ in range(self.pairs)]
            self.batch = augment_batch(data.batch(*chosen), NO_AUGMENTATION, generators, size)

    @torch.inference_mode()
    def __call__(self, network: nn.Module, drawn: bool = False) -> tuple[dict[str, float], np.ndarray | None]:
        """Returns the losses of `network` by name and, if `drawn`, a picture (H,W,3) uint8."""
        if not self.pairs:
            return {}, None
        modes = [(part, part.training) for part in network.modules()]
        network.eval()
        try:
            outputs = network(self.batch.image, self.batch.mask)
        finally:
            for part, mode in modes:
                part.training = mode
        total, terms = losses(outputs, self.batch, self.loss)
        values = {name: float(value) for name, value in {"loss": total, **terms}.items()}
        return values, self.picture(outputs) if drawn else None

    def picture(self, outputs: dict[str, Tensor]) -> np.ndarray:
        """Draws two rows for each of the first pairs, ground truth above prediction, with the pairs in two columns.

        The cells are the image (albedo * shading), albedo, shading, lit ball, and the figure under the light of
        the next pair.
        """
        batch, inferred = self.batch, Comparison(outputs, self.batch, self.loss.reduction)
        white = batch.shading.flatten(1).amax(1).clamp_min(1.0)  # shading that is drawn as white, of each pair
        rows = []  # of cells (B,h,w,3) and lights (B,K,3): the truth, then what is inferred
        for albedo, transport, light, shading in (
            (batch.albedo, batch.transport, batch.light, batch.shading),
            (inferred.albedo, inferred.transport, inferred.light, inferred.shading("transport_light")),
        ):
            relit = albedo * shade(transport, batch.light.roll(-1, 0))
            cells = [albedo * shading, albedo, shading / white[:, None, None], relit]
            rows.append((self._cells([cell * batch.inside for cell in cells]), light.cpu().numpy()))
        blocks = []
        for pair in range(min(self.pairs, MAX_DRAWN)):
            lines = []
            for (*panels, last), lights in rows:
                cell = ball_cell(lights[pair], last.shape[1:3], float(white[pair]), self.color == "photo")
                lines.append([*(panel[pair] for panel in panels), cell, last[pair]])
            blocks.append(concatenated([concatenated(line, 1) for line in lines], 0))
        if len(blocks) > 1 and len(blocks) % 2:
            blocks.append(np.full_like(blocks[0], BACKGROUND))
        pairs_of_blocks = [concatenated(blocks[i : i + 2], 1, 4 * GAP) for i in range(0, len(blocks), 2)]
        return to_bytes(concatenated(pairs_of_blocks, 0, 4 * GAP))

    def _cells(self, compact: list[Tensor]) -> list[np.ndarray]:
        """Returns compact maps (B,P,3) as cropped pictures (B,h,w,3) for display, at most MAX_HEIGHT high."""
        batch = self.batch
        rows, columns = extent(batch.mask.amax((0, 1)).cpu().numpy())
        window = (..., slice(*rows), slice(*columns))
        shrink = -(-(rows[1] - rows[0]) // MAX_HEIGHT)
        pictures = []
        for values in compact:
            values = values.clamp(0, 1)
            dense = batch.scatter(encode(values) if self.color == "photo" else values)
            cell = (dense + BACKGROUND * (1 - batch.mask))[window]
            cell = F.avg_pool2d(cell, shrink) if shrink > 1 else cell
            pictures.append(cell.permute(0, 2, 3, 1).cpu().numpy())
        return pictures


def ball_cell(light: np.ndarray, shape: tuple[int, int], white: float, linear: bool) -> np.ndarray:
    """Returns a cell (h,w,3) of a shape (h,w) with a ball under a light (K,3) in its middle, as `lit_ball` draws it."""
    from relight.lights import lit_ball

    height, width = shape
    ball = lit_ball(light, min(height, width), white, linear)
    cell = np.full((height, width, 3), BACKGROUND, np.float32)
    top, left = (height - len(ball)) // 2, (width - len(ball)) // 2
    middle = cell[top : top + len(ball), left : left + len(ball)]
    middle[:] = ball[..., :3] * ball[..., 3:] + middle * (1 - ball[..., 3:])
    return cell


def concatenated(parts: list[np.ndarray], axis: int, gap: int = GAP) -> np.ndarray:
    """Concatenates pictures (h,w,3), one below another (axis 0) or side by side (1), with gaps of background."""
    shape = list(parts[0].shape)
    shape[axis] = gap
    space = np.full(shape, BACKGROUND, np.float32)
    return np.concatenate([part for picture in parts for part in (picture, space)][:-1], axis)
