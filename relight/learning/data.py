"""Relit batches from the packed set, made on the device: no loader, no workers, nothing rendered in advance.

Only the pixels inside the masks are stored and computed with, as compact maps (B,P,C): the in-mask pixels of each image
row by row, padded with zeros to P. In a batch of the packed set P is the most pixels of any figure, so that shapes
never change.
"""

import json
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from relight.files import UserError, existing_file
from relight.learning.camera import photograph, quantised, shade
from relight.learning.harmonics import mirror_signs
from relight.maps import PackedMaps
from relight.npz import read_npz
from relight.progress import progress
from relight.sh import order_of

MULTIPLE = 64  # P is a multiple of it


@dataclass(frozen=True, kw_only=True)
class CompactIndex:
    """Where the pixels of compact maps are in their images; differences between neighbours need it."""

    pixel: Tensor  # (B*P,) index of each pixel among the B*S*S; that of the padding is outside the mask
    inside: Tensor  # (B,P,1) 1 for pixels, 0 for padding
    interior: Tensor  # (B,P,1) 1 where all four neighbours are in the mask; the right one is the next in the row
    below: Tensor  # (B*P,) index among the B*P of the pixel below each interior pixel, else its own

    def take(self, dense: Tensor) -> Tensor:
        """The in-mask pixels (B,P,C), float32, of a dense map (B,C,S,S)."""
        rows = dense.permute(0, 2, 3, 1).reshape(-1, dense.shape[1])  # no copy when channels_last
        # Pixels are distinct, so the gradient of this gather adds to each place once, in no order: it is deterministic.
        return rows.index_select(0, self.pixel).float().view(len(dense), -1, dense.shape[1]) * self.inside


def index_of(mask: Tensor) -> CompactIndex:
    """The index of masks (B,1,S,S) bool; each image needs a pixel outside its mask."""
    batch, size = len(mask), mask.shape[-1]
    padded = F.pad(mask[:, 0], (1, 1, 1, 1))
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
    return CompactIndex(
        pixel=(pixel + start * size * size).flatten(),
        inside=inside,
        interior=interior,
        below=(below + start * most).flatten(),
    )


@dataclass(frozen=True, kw_only=True)
class Batch(CompactIndex):
    """Input of the network and ground truth for B pairs of figure and light. Compact maps are zero at their padding."""

    image: Tensor  # (B,3,S,S) what the camera records, zero outside the mask
    mask: Tensor  # (B,1,S,S) of 0 and 1
    albedo: Tensor  # (B,P,3)
    transport: Tensor  # (B,P,K)
    normal: Tensor  # (B,P,3) unit, camera frame
    ao: Tensor  # (B,P,1)
    gloss: Tensor | None = None  # (B,P,2) roughness and specular, as in `relight.meshes.Material`, where they are known
    light: Tensor  # (B,K,3)
    shading: Tensor  # (B,P,3) transport . light of all bands in [0,10]
    relit: Tensor  # (B,P,3) albedo * shading, before the camera
    exposure: Tensor  # (B,) of the camera: a factor on the light that `light`, `shading` and `relit` do not have
    size: int  # S
    scope: float  # pixels in the masks of one batch, for reduction=mask

    def put(self, compact: Tensor) -> Tensor:
        """The dense map (B,C,S,S), zero outside the mask, of a compact one."""
        return put(compact, self.pixel, self.size)


def put(compact: Tensor, pixel: Tensor, size: int) -> Tensor:
    """Scatters (B,P,C) to (B,C,S,S), channels_last; the padding's zeros go to pixels outside the mask."""
    batch, _, channels = compact.shape
    dense = compact.new_zeros(batch * size * size, channels)
    dense[pixel] = compact.reshape(-1, channels)
    return dense.view(batch, size, size, channels).permute(0, 3, 1, 2)


class RelitSet:
    """The figures of a packed set and a table of lights on one device; relights any pairs of them."""

    def __init__(self, packed: Path, lights: Path, order: int, color: str, device: torch.device | str = "cpu"):
        """Loads the files.

        Images and shadings are lit by all bands of the files; transport and lights of a batch end at `order`. So what a
        network of that order cannot express counts as its error.

        Args:
            packed: packed maps (relight.maps.packed).
            lights: light set (relight.lights.table).
            order: of the harmonics that the network infers.
            color: `paper` takes the 8-bit sRGB codes of the albedo as if they were linear; `photo` takes linear albedo.
            device: of all tensors.

        Raises:
            UserError: if a file does not exist or holds fewer bands than `order`.
        """
        figures = PackedMaps(packed)
        table = read_npz(lights, "light set")
        if not {"coefficients", "split"} <= set(table) or table["coefficients"].ndim != 3:
            raise UserError(f"{lights} is not a light set of relight (it lacks coefficients (N, K, 3), or the split)")
        self.coefficients = (order + 1) ** 2
        bands = order_of(table["coefficients"].shape[1])
        for path, found in ((packed, figures.order), (lights, bands)):
            if found < order:
                raise UserError(
                    f"{path} has harmonics up to order {found}: model.order={order} needs bake.order={order}"
                )
        self.names, self.size, self.color = list(figures.names), figures.size, color
        self.shown, self.turned = list(figures.figures), np.array([view is not None for view in figures.views])
        self.light_split = np.asarray(table["split"])
        self.order = min(figures.order, bands)
        all_bands = (self.order + 1) ** 2
        self.lights = torch.tensor(table["coefficients"][:, :all_bands], dtype=torch.float32, device=device)
        arrays = figures.arrays()
        offset = np.asarray(arrays["offset"], np.int64)
        self.counts = np.diff(offset)
        self.most = int(-(-self.counts.max() // 64) * 64)
        below, interior, outside = neighbours(np.asarray(arrays["pixel"]), offset, self.size)

        def load(array: np.ndarray) -> Tensor:
            return torch.from_numpy(np.array(array)).to(device)

        self.pixel, self.below, self.interior = load(arrays["pixel"]), load(below), load(interior)
        self.offset, self.count, self.outside = load(offset[:-1]), load(self.counts), load(outside)
        self.transport = load(arrays["transport"][:, :all_bands])
        self.normal, self.ao, albedo = load(arrays["normal"]), load(arrays["ao"]), load(arrays["albedo"])
        self.albedo = quantised(albedo.float()) if color == "paper" else albedo
        self.gloss = load(arrays["gloss"]) if figures.glossy else None
        self.signs = mirror_signs(self.order).to(device)

    def figures(self, names: list[str]) -> np.ndarray:
        """Indices of the named figures, in order, without those that the packed set lacks."""
        place = {name: i for i, name in enumerate(self.names)}
        return np.array([place[name] for name in names if name in place], np.int64)

    def others(self, figures: np.ndarray) -> np.ndarray:
        """Indices of the further views and outfits of `figures`, which are indices of their own frontal views."""
        chosen = {self.names[figure] for figure in figures}
        found = [i for i, shown in enumerate(self.shown) if shown in chosen and shown != self.names[i]]
        return np.array(found, np.int64)

    def batch(
        self,
        figure: np.ndarray,
        light: np.ndarray,
        mirror: np.ndarray | None = None,
    ) -> Batch:
        """Relights B pairs.

        Args:
            figure: (B,) int indices.
            light: (B,) int indices.
            mirror: (B,) bool, which pairs are mirrored left to right: image, maps and light. Their compact maps keep
                the order of the unmirrored pixels.
        """
        device, size, most = self.pixel.device, self.size, self.most
        chosen = torch.as_tensor(figure, device=device)
        slot = torch.arange(most, device=device)
        count = self.count[chosen, None]
        inside = (slot < count).float()[..., None]
        rows = self.offset[chosen, None] + torch.minimum(slot, count - 1)
        pixel = torch.where(slot < count, self.pixel[rows], self.outside[chosen, None])
        below = torch.where(slot < count, self.below[rows], slot)

        albedo = self.albedo[rows].float() * inside
        if self.color == "paper":
            albedo = albedo / 255
        transport, normal = self.transport[rows].float() * inside, self.normal[rows].float() * inside
        lights = self.lights[torch.as_tensor(light, device=device)]
        if mirror is not None:
            flip = torch.as_tensor(mirror, device=device)[:, None]
            pixel = torch.where(flip, pixel + size - 1 - 2 * (pixel % size), pixel)
            signs = torch.where(flip, self.signs, 1.0)
            transport, lights = transport * signs[:, None, :], lights * signs[..., None]
            normal = (
                normal * torch.stack([1 - 2.0 * flip[:, 0], *2 * [torch.ones(len(flip), device=device)]], 1)[:, None]
            )

        shading = shade(transport, lights)
        relit = albedo * shading
        image_start = torch.arange(len(chosen), device=device)[:, None]
        pixel = (pixel + image_start * size * size).flatten()
        return Batch(
            image=put(photograph(relit, self.color), pixel, size),
            mask=put(inside, pixel, size),
            albedo=albedo,
            transport=transport[..., : self.coefficients],
            normal=normal,
            ao=self.ao[rows].float()[..., None] * inside,
            gloss=None if self.gloss is None else self.gloss[rows].float() * inside,
            light=lights[:, : self.coefficients],
            shading=shading,
            relit=relit,
            inside=inside,
            interior=self.interior[rows].float()[..., None] * inside,
            pixel=pixel,
            below=(below + image_start * most).flatten(),
            exposure=torch.ones(len(chosen), device=device),
            size=size,
            scope=float(self.counts[figure].sum()),
        )


def neighbours(pixel: np.ndarray, offset: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the neighbours of pixels in masks.

    Args:
        pixel: flat indices of all masks' pixels, ascending within each figure.
        offset: (figures+1,) where each figure's pixels begin.
        size: of the images, pixels.

    Returns:
        below (pixels,) int32, the place of the pixel underneath within its figure, its own if not interior; interior
        (pixels,) bool, whether all four neighbours are in the mask; outside (figures,) int32, a background pixel.
    """
    below, interior = np.empty(len(pixel), np.int32), np.empty(len(pixel), bool)
    outside = np.zeros(len(offset) - 1, np.int32)
    for figure, (first, last) in enumerate(progress(list(pairwise(offset)), "figures loaded")):
        own = pixel[first:last]
        mask = np.zeros((size + 2, size + 2), bool)
        mask[1:-1, 1:-1].flat[own] = True
        eroded = mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
        place = np.cumsum(mask[1:-1, 1:-1].ravel(), dtype=np.int32) - 1
        interior[first:last] = eroded.ravel()[own]
        below[first:last] = np.where(
            interior[first:last], place[np.minimum(own + size, size * size - 1)], np.arange(len(own))
        )
        outside[figure] = np.argmin(mask[1:-1, 1:-1].ravel())
    return below, interior, outside


def read_split(path: Path) -> dict[str, list[str]]:
    """Reads a split: names of figures by part, `train`, `test` and `sitting`; raises UserError on any other file."""
    try:
        parts = json.loads(existing_file(path, "split").read_text())
        if all(isinstance(name, str) for names in parts.values() for name in names):
            return parts
    except (ValueError, AttributeError, TypeError, RecursionError):
        pass
    raise UserError(f"{path} is not a split of relight: it has lists of names of figures, such as train and test")


def pairs(seed: int, step: int, batch: int, figures: int, lights: int, order: str = "shuffled") -> np.ndarray:
    """Which figure is seen under which light at a step: a function of seed and step alone, so nothing needs saving.

    Each epoch shows every pair exactly once. A batch may reach over the end of an epoch into the next.

    Args:
        seed: of the training.
        step: from 0.
        batch: pairs of a step.
        figures: how many there are.
        lights: how many there are.
        order: `shuffled`, all pairs of an epoch in random order; or `rows`, the figures in random order and the lights
            of each in a row, as the authors do.

    Returns:
        (batch, 2) int64 indices of figure and light.
    """
    epoch, place = np.divmod(step * batch + np.arange(batch), figures * lights)
    chosen = np.array([epoch_order(seed, int(e), figures, lights, order)[p] for e, p in zip(epoch, place)])
    return np.stack([chosen // lights, chosen % lights], 1)


@lru_cache(maxsize=4)
def epoch_order(seed: int, epoch: int, figures: int, lights: int, order: str) -> np.ndarray:
    """The order (figures * lights,) in which an epoch shows the pairs, numbered figure * lights + light."""
    rng = generator(seed, epoch)
    if order == "shuffled":
        return rng.permutation(figures * lights)
    rows = rng.permutation(figures)[:, None] * lights
    return (rows + rng.permuted(np.tile(np.arange(lights), (figures, 1)), axis=1)).ravel()


def generator(seed: int, counter: int, purpose: int = 0) -> np.random.Generator:
    """The random numbers of (seed, counter, purpose), independent of all others."""
    return np.random.Generator(np.random.Philox(key=[seed, (purpose << 48) + counter]))
