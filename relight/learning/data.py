"""Relights batches of the packed set on the device, without loader, workers or pictures rendered in advance.

Only the pixels inside the masks are stored and computed with, as compact maps (B,P,C): the in-mask pixels of each image
row by row, padded with zeros to P. In batches of the packed set P is the largest number of pixels of any figure, which
makes shapes constant.
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

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.core.npz import read_npz
from relight.core.progress import progress
from relight.core.text import read_text
from relight.learning.color import photograph, quantised, shade
from relight.learning.harmonics import mirror_signs
from relight.maps import PackedMaps
from relight.sh import order_of

MULTIPLE = 64  # P is a multiple of it


def choose_device(name: str) -> torch.device:
    """Returns the device `cpu` or `cuda`; `auto` prefers a GPU. Raises UserError if there is none for `cuda`."""
    has_gpu = torch.cuda.is_available()
    if name == "cuda" and not has_gpu:
        raise UserError("train.device=cuda, but torch finds no GPU: give train.device=cpu or auto")
    return torch.device("cuda" if has_gpu and name != "cpu" else "cpu")


@dataclass(frozen=True, kw_only=True)
class CompactIndex:
    """The positions of the pixels of compact maps in their images.

    Attributes:
        pixel: (B*P,) index of each pixel among the B*S*S; for padding, that of a pixel outside the mask.
        inside: (B,P,1) 1 for pixels, 0 for padding.
        interior: (B,P,1) 1 where all four neighbours are in the mask; the next entry is then the right neighbour.
        below: (B*P,) index among the B*P of the pixel below each interior pixel; for other pixels, their own.
    """

    pixel: Tensor
    inside: Tensor
    interior: Tensor
    below: Tensor

    def gather(self, dense: Tensor) -> Tensor:
        """Gathers the in-mask pixels (B,P,C), float32, of a dense map (B,C,S,S)."""
        rows = dense.permute(0, 2, 3, 1).reshape(-1, dense.shape[1])  # no copy when channels_last
        # Pixels are distinct, so the gradient adds to each element once and is deterministic.
        return rows.index_select(0, self.pixel).float().view(len(dense), -1, dense.shape[1]) * self.inside


def compact_index(mask: Tensor) -> CompactIndex:
    """Returns the index that gathers the pixels of masks into compact maps (B,P,C).

    P is the largest number of pixels in a mask, rounded up to MULTIPLE; maps of smaller masks are padded.

    Args:
        mask: (B,1,S,S) bool; each image needs a pixel outside its mask, to which the padding points.
    """
    batch, size = len(mask), mask.shape[-1]
    padded = F.pad(mask[:, 0], (1, 1, 1, 1))
    eroded = mask[:, 0] & padded[:, :-2, 1:-1] & padded[:, 2:, 1:-1] & padded[:, 1:-1, :-2] & padded[:, 1:-1, 2:]
    flat, eroded = mask.flatten(1), eroded.flatten(1)
    width = -(-int(flat.sum(1).max()) // MULTIPLE) * MULTIPLE  # P
    rank = flat.cumsum(1) - 1  # place of each in-mask pixel in its compact map
    image, flat_index = flat.nonzero(as_tuple=True)
    slot = rank[image, flat_index]
    first_outside = (~flat).int().argmax(1)
    pixel = first_outside[:, None].repeat(1, width)
    pixel[image, slot] = flat_index
    below = torch.arange(width, device=mask.device).repeat(batch, 1)
    slot_below = rank[image, (flat_index + size).clamp_max(size * size - 1)]
    is_interior = eroded[image, flat_index]
    below[image, slot] = torch.where(is_interior, slot_below, slot)
    inside, interior = (torch.zeros(batch, width, 1, device=mask.device) for _ in range(2))
    inside[image, slot] = 1
    interior[image, slot, 0] = is_interior.float()
    image_start = torch.arange(batch, device=mask.device)[:, None]
    return CompactIndex(
        pixel=(pixel + image_start * size * size).flatten(),
        inside=inside,
        interior=interior,
        below=(below + image_start * width).flatten(),
    )


@dataclass(frozen=True, kw_only=True)
class Batch(CompactIndex):
    """Input of the network and ground truth for B pairs of figure and light. Compact maps are zero at their padding.

    Attributes:
        image: (B,3,S,S) network input in the color model of the training, zero outside the mask.
        mask: (B,1,S,S) of 0 and 1.
        albedo: (B,P,3) linear, or sRGB codes / 255 in the color model `paper`.
        transport: (B,P,K).
        normal: (B,P,3) unit, camera frame.
        ao: (B,P,1) in [0,1].
        gloss: (B,P,2) roughness and specular, as in `relight.meshes.Material`; None if unknown.
        light: (B,K,3) radiance coefficients.
        shading: (B,P,3) transport . light of all bands, in [0,10].
        relit: (B,P,3) albedo * shading, before the camera.
        exposure: (B,) factor that the camera applies; `light`, `shading` and `relit` are without it.
        size: S, pixels.
        mask_pixels: number of pixels in all masks of a batch, the divisor of reduction=mask.
        other_light: (B,K,3), for the losses under another light; None: that of the previous pair of the batch.
    """

    image: Tensor
    mask: Tensor
    albedo: Tensor
    transport: Tensor
    normal: Tensor
    ao: Tensor
    gloss: Tensor | None = None
    light: Tensor
    shading: Tensor
    relit: Tensor
    exposure: Tensor
    size: int
    mask_pixels: float
    other_light: Tensor | None = None

    def scatter(self, compact: Tensor) -> Tensor:
        """Scatters a compact map (B,P,C) to a dense one (B,C,S,S), zero outside the mask."""
        return scatter(compact, self.pixel, self.size)


def scatter(compact: Tensor, pixel: Tensor, size: int) -> Tensor:
    """Scatters a compact map to a dense one.

    Args:
        compact: (B,P,C), zero at the padding.
        pixel: (B*P,) index among the B*S*S pixels; that of the padding is outside the mask.
        size: S, pixels.

    Returns:
        (B,C,S,S), channels_last, zero outside the mask.
    """
    batch, _, channels = compact.shape
    dense = compact.new_zeros(batch * size * size, channels)
    dense[pixel] = compact.reshape(-1, channels)
    return dense.view(batch, size, size, channels).permute(0, 3, 1, 2)


class RelitSet:
    """The figures of a packed set and a table of lights on one device; relights any pairs of them.

    There are F maps of figures with P pixels in all, N lights, and K coefficients of `order`.

    Attributes:
        names, figure_of, subject_of: of each map, its name, that of the frontal view of its figure, and the person.
        size: S of the square images, pixels.
        color: color model, `paper` or `photo`.
        coefficients: K' that a batch has, up to the order of the network.
        order: highest band of the files, by which images are relit.
        lights, light_split: (N,K,3) and (N,) the split of each light.
        counts: (F,) pixels of each map, a NumPy array; `count` is the same on the device.
        max_pixels: the largest of these, rounded up to a multiple of MULTIPLE.
        offset: (F,) where the pixels of each map begin.
        pixel, below, interior, outside: see `neighbours`; pixel (P,) is the flat index in the image.
        transport, normal, ao, albedo, gloss: (P,...) maps; albedo is linear, or uint8 sRGB codes with `paper`.
        signs: (K,) of the coefficients under mirroring.
    """

    def __init__(self, packed: Path, lights: Path, order: int, color: str, device: torch.device | str = "cpu"):
        """Loads the files.

        Images and shadings use all bands of the files; transport and lights of a batch end at `order`. So the losses of
        a network include the error of truncating the harmonics.

        Args:
            packed: packed maps (relight.maps.packed).
            lights: light set (relight.lights.table).
            order: order of the harmonics that the network infers.
            color: `paper` uses the 8-bit sRGB codes of the albedo as linear values; `photo` uses linear albedo.
            device: device of all tensors.

        Raises:
            UserError: if a file does not exist or holds fewer bands than `order`.
        """
        figures = PackedMaps(packed)
        table = read_npz(lights, "light set")
        if not {"coefficients", "split"} <= set(table) or table["coefficients"].ndim != 3:
            raise UserError(
                f"{lights} is not a light set of relight (coefficients (N, K, 3) or split are missing): "
                "give one of the rule lights"
            )
        self.coefficients = (order + 1) ** 2
        bands = order_of(table["coefficients"].shape[1])
        for path, file_order in ((packed, figures.order), (lights, bands)):
            if file_order < order:
                raise UserError(
                    f"{path} has harmonics up to order {file_order}: model.order={order} needs bake.order={order}"
                )
        self.names, self.size, self.color = list(figures.names), figures.size, color
        self.figure_of, self.subject_of = list(figures.figures), list(figures.subjects)
        self.light_split = np.asarray(table["split"])
        self.order = min(figures.order, bands)
        all_bands = (self.order + 1) ** 2
        self.lights = torch.tensor(table["coefficients"][:, :all_bands], dtype=torch.float32, device=device)
        arrays = figures.arrays()
        offset = np.asarray(arrays["offset"], np.int64)
        self.counts = np.diff(offset)
        self.max_pixels = int(-(-self.counts.max() // MULTIPLE) * MULTIPLE)
        below, interior, outside = neighbours(np.asarray(arrays["pixel"]), offset, self.size)

        def load(array: np.ndarray) -> Tensor:
            """Copies an array, which may be a read-only view of the file, to the device."""
            return torch.from_numpy(np.array(array)).to(device)

        self.pixel, self.below, self.interior = load(arrays["pixel"]), load(below), load(interior)
        self.offset, self.count, self.outside = load(offset[:-1]), load(self.counts), load(outside)
        self.transport = load(arrays["transport"][:, :all_bands])
        self.normal, self.ao, albedo = load(arrays["normal"]), load(arrays["ao"]), load(arrays["albedo"])
        self.albedo = quantised(albedo.float()) if color == "paper" else albedo
        self.gloss = load(arrays["gloss"]) if figures.glossy else None
        self.signs = mirror_signs(self.order).to(device)

    def figures(self, names: list[str]) -> np.ndarray:
        """Returns the indices of the named figures, in order, without those that the packed set lacks."""
        place = {name: i for i, name in enumerate(self.names)}
        return np.array([place[name] for name in names if name in place], np.int64)

    def other_views(self, figures: np.ndarray) -> np.ndarray:
        """Returns the indices of the other views and outfits of `figures`, which are indices of frontal views."""
        chosen = {self.names[figure] for figure in figures}
        indices = [i for i, figure in enumerate(self.figure_of) if figure in chosen and figure != self.names[i]]
        return np.array(indices, np.int64)

    def batch(self, figure: np.ndarray, light: np.ndarray, mirror: np.ndarray | None = None) -> Batch:
        """Relights B pairs.

        Args:
            figure: (B,) int indices of maps.
            light: (B,) int indices of lights.
            mirror: (B,) bool, which pairs are mirrored left to right: image, maps and light. Their compact maps keep
                the order of the unmirrored pixels.

        Returns:
            The batch, at exposure 1.
        """
        device, size, width = self.pixel.device, self.size, self.max_pixels
        chosen = torch.as_tensor(figure, device=device)
        slot = torch.arange(width, device=device)
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
            mirrored_x = torch.tensor([-1.0, 1.0, 1.0], device=device)
            normal = normal * torch.where(flip, mirrored_x, 1.0)[:, None]

        shading = shade(transport, lights)
        relit = albedo * shading
        image_start = torch.arange(len(chosen), device=device)[:, None]
        pixel = (pixel + image_start * size * size).flatten()
        return Batch(
            image=scatter(photograph(relit, self.color), pixel, size),
            mask=scatter(inside, pixel, size),
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
            below=(below + image_start * width).flatten(),
            exposure=torch.ones(len(chosen), device=device),
            size=size,
            mask_pixels=float(self.counts[figure].sum()),
        )


def neighbours(pixel: np.ndarray, offset: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the neighbours of pixels in masks.

    Args:
        pixel: flat indices of all masks' pixels, ascending within each figure.
        offset: (figures+1,) where each figure's pixels begin.
        size: side of the square images, pixels.

    Returns:
        below (pixels,) int32, the index within its figure of the pixel below, or the pixel's own if not interior;
        interior (pixels,) bool, whether all four neighbours are in the mask; outside (figures,) int32, the flat index
        of a background pixel.
    """
    below, interior = np.empty(len(pixel), np.int32), np.empty(len(pixel), bool)
    outside = np.zeros(len(offset) - 1, np.int32)
    for figure, (first, last) in enumerate(progress(list(pairwise(offset)), "figures loaded")):
        mask = np.zeros(size * size, bool)
        mask[pixel[first:last]] = True
        index = compact_index(torch.from_numpy(mask).view(1, 1, size, size))
        interior[first:last] = index.interior[0, : last - first, 0]  # without the padding
        below[first:last] = index.below[: last - first]  # flat, as `batch` needs it
        outside[figure] = np.argmin(mask)
    return below, interior, outside


def read_split(path: Path) -> dict[str, list[str]]:
    """Reads a split: names of figures by part, such as `train`, `test`, `validation` and `sitting`.

    Raises:
        UserError: if the file is no split.
    """
    try:
        parts = json.loads(read_text(existing_file(path, "split")))
        names = [name for part in parts.values() for name in part]
        lists = all(isinstance(part, list) for part in parts.values())
        if lists and {"train", "test"} <= set(parts) and all(isinstance(name, str) for name in names):
            return parts
    except (ValueError, AttributeError, TypeError, RecursionError):
        pass
    raise UserError(
        f"{path} is not a split of relight: a split holds lists of names of figures, such as train and test"
    )


def draw_pairs(seed: int, step: int, batch: int, figures: int, lights: int, order: str = "shuffled") -> np.ndarray:
    """Returns the pairs of figure and light of a step, a function of seed and step alone.

    Each epoch shows every pair exactly once. A batch may span the end of one epoch and the start of the next.

    Args:
        seed: random seed of the training.
        step: from 0.
        batch: pairs of a step.
        figures: number of figures.
        lights: number of lights.
        order: `shuffled`, all pairs of an epoch in random order; or `rows`, the figures in random order and the lights
            of each in a row, as the authors do.

    Returns:
        (batch, 2) int64 indices of figure and light.
    """
    epoch, place = np.divmod(step * batch + np.arange(batch), figures * lights)
    chosen = np.array([_epoch_order(seed, int(e), figures, lights, order)[p] for e, p in zip(epoch, place)])
    return np.stack([chosen // lights, chosen % lights], 1)


@lru_cache(maxsize=4)
def _epoch_order(seed: int, epoch: int, figures: int, lights: int, order: str) -> np.ndarray:
    """Returns the pairs (figures * lights,) of an epoch in their order, as figure * lights + light."""
    rng = generator(seed, epoch)
    if order == "shuffled":
        return rng.permutation(figures * lights)
    rows = rng.permutation(figures)[:, None] * lights
    return (rows + rng.permuted(np.tile(np.arange(lights), (figures, 1)), axis=1)).ravel()


def generator(seed: int, counter: int, purpose: int = 0) -> np.random.Generator:
    """Returns the random generator of a training's seed and a counter below 2^48, such as the step.

    It is independent of all others; `purpose` separates uses that count the same things.
    """
    return np.random.Generator(np.random.Philox(key=[seed, (purpose << 48) + counter]))
