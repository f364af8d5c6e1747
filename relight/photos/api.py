"""The Python interface: `relight.load()` and what one does with it. Pictures are arrays, Pillow's images, or files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from relight.files import UserError
from relight.photos.background import Background, background
from relight.photos.frame import SOLID, Frame
from relight.photos.infer import Figure, infer
from relight.photos.mask import mask_of, people
from relight.photos.read import Photo, mask_image, photo_of, read_photo
from relight.photos.relight import matched
from relight.photos.relit import Relit
from relight.photos.render import render
from relight.photos.source import mask_beside
from relight.photos.trust import Trust, trust
from relight.sh import rotate_y

WEIGHTS = Path(__file__).parent.parent / "weights" / "photo.safetensors"
MODES = ("ratio", "full")
Picture = np.ndarray | Image.Image | Path | str


class Relighter:
    """A network that is ready for photos. config: the network's; lights (N,K,3): those of its training, or None."""

    def __init__(self, network, config: dict, lights: np.ndarray | None = None):
        self.network, self.config, self.lights = network, config, lights

    @property
    def order(self) -> int:
        return self.network.order

    def infer(self, image: Picture, mask: Picture | None = None, split: bool = True) -> list[Figure]:
        """Each person's light, albedo and transport, from left to right.

        image: (H,W,3) uint8 sRGB, Pillow's image, or a file; mask: (H,W) bool, uint8 of 0..255 or float in [0,1], soft
        edges welcome, Pillow's image, or a file; without one it is found as for `relight photo` (docs/photos.md).
        split: people that do not touch are inferred one by one. Raises UserError for what is none of these, and for
        empty masks.
        """
        photo, coverage = _given(image, mask)
        figures = people(coverage) if split else [coverage]
        return [infer(self.network, self.config, photo.pixels, figure) for figure in figures]

    def look(self, image: np.ndarray, coverage: np.ndarray, box: Frame) -> Figure:
        """The same for one figure in a given square, for movies."""
        return infer(self.network, self.config, image, coverage, box)

    def light(self, light: np.ndarray | str, figures: Sequence[Figure] = (), match: bool = True) -> np.ndarray:
        """(K,3) of a light as coefficients or as a user names it (docs/photos.md), of the exposure of `figures`."""
        if not isinstance(light, np.ndarray):
            from relight.photos.source import light_source

            light = light_source(str(light), self).coefficients
        light = np.asarray(light, np.float32)
        return light * exposure(figures, light) if match and figures else light

    def relight(
        self,
        image: Picture,
        mask: Picture | None = None,
        light: np.ndarray | str = "room:7",
        mode: str = "ratio",
        behind: Background | str = "keep",
        turn: float = 0.0,
        match: bool = True,
        stops: float = 0.0,
    ) -> Relit:
        """`image` with the people under `mask` in another light: (H,W,3) uint8, (H,W,4) if transparent.

        image, mask: as in `infer`. light: (K,3) radiance coefficients (docs/conventions.md) or text: "kitchen.hdr",
        "room:12", "key:#ffeedd@45,30".
        mode: `ratio` keeps all detail of the photo, `full` shows albedo * shading. turn: degrees about the vertical,
        the light's front toward +x. match: scale the light to the photo's exposure. stops: brighter by powers of two.
        """
        if mode not in MODES:
            raise UserError(f"mode {mode!r} is neither ratio nor full")
        photo, coverage = _given(image, mask)
        figures = self.infer(photo.pixels, coverage)
        behind = background(behind) if isinstance(behind, str) else behind
        light = self.light(light)
        needed = exposure(figures, light)
        factor = needed if match else 1.0
        behind = behind.under(light * factor, factor, factor / needed)
        turned = rotate_y(light * factor, np.radians(turn)).astype(np.float32)
        return Relit.of(render(photo.pixels, figures, turned, mode, behind, np.radians(turn), stops), photo.pixels)

    def trust(self, figure: Figure) -> Trust:
        """How far to trust this inference, in numbers and words."""
        return trust(figure, self.lights, self.config.get("augment", {}).get("exposure", [0.0])[-1])


def exposure(figures: Sequence[Figure], light: np.ndarray) -> float:
    """The factor on `light` that keeps the photo's exposure: the geometric mean over its people."""
    return float(np.exp(np.mean([np.log(matched(f.light, light, f.transport, f.mask)) for f in figures])))


def load(path: Path | str | None = None, threads: int | None = None) -> Relighter:
    """The network that comes with the package, that of a .safetensors checkpoint of ours, or a model in MLflow, such as
    models:/relight@photo.

    threads: of torch; its own choice by default. Raises UserError for anything that is no such checkpoint.
    """
    import torch

    from relight.learning.checkpoint import load_network

    if path is None and not WEIGHTS.is_file():
        raise UserError("this installation has no weights: give a checkpoint with --weights FILE.safetensors")
    if str(path).startswith("models:/"):
        from relight.track import downloaded

        path = downloaded(str(path))
    path = Path(path or WEIGHTS)
    if path.is_file() and path.suffix in (".pt", ".pth", ".pkl", ".pickle", ".ckpt"):
        raise UserError(
            f"{path} is a pickle, which can run code when it is read: give a .safetensors checkpoint of relight"
        )
    if threads:
        torch.set_num_threads(threads)
    network, config = load_network(path)
    return Relighter(network, config, _training_lights(config, network.order))


def _training_lights(config: dict, order: int) -> np.ndarray | None:
    lights = config.get("lights")
    return np.asarray(lights, np.float32).reshape(-1, (order + 1) ** 2, 3) if lights else None


def _given(image: Picture, mask: Picture | None) -> tuple[Photo, np.ndarray]:
    """A photo and its coverage (H,W) uint8, of whatever kind they are given. Raises UserError."""
    file = isinstance(image, str | Path)
    if file:
        photo = read_photo(image)
    else:
        photo = photo_of(image) if isinstance(image, Image.Image) else Photo(_image(image), None, "image")
    if mask is None or isinstance(mask, str | Path):
        return photo, mask_of(photo, mask or (mask_beside(image) if file else None))
    coverage = _coverage(mask_image(mask, photo.pixels.shape[:2]) if isinstance(mask, Image.Image) else mask)
    if photo.pixels.shape[:2] != coverage.shape:
        raise UserError(
            f"the mask is {coverage.shape[::-1]} pixels, the image {photo.pixels.shape[1::-1]}: they must be equal"
        )
    return photo, coverage


def _image(image: np.ndarray) -> np.ndarray:
    image = np.asarray(image)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise UserError(f"the image is {image.dtype} {image.shape}: give (height, width, 3) uint8 sRGB")
    return image


def _coverage(mask: np.ndarray) -> np.ndarray:
    mask = np.asarray(mask)
    if mask.ndim != 2:
        raise UserError(f"the mask has shape {mask.shape}: give (height, width)")
    if mask.dtype == bool:
        mask = mask * np.uint8(255)
    elif mask.dtype != np.uint8:
        mask = np.round(np.clip(np.nan_to_num(mask.astype(np.float32)), 0, 1) * 255).astype(np.uint8)
    if not (mask >= SOLID).any():
        raise UserError("the mask is empty: no pixel of it is at least half white")
    return mask
