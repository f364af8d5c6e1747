"""One picture of the benchmark: a figure path traced in panoramas, as a camera takes it, and the truth about it."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from relight.benchmark.lights import panorama, sky_of
from relight.benchmark.measures import Intrinsics
from relight.benchmark.recipes import Recipe
from relight.benchmark.shots import Shot, variants
from relight.config import NO_AUGMENTATION
from relight.learning.augment import developed
from relight.maps import Maps
from relight.meshes import Mesh
from relight.panoramas import Panorama, project
from relight.photos.crop import MASK_THRESHOLD, Crop
from relight.photos.environment import camera_view
from relight.srgb import encode, to_bytes
from relight.transport import Baker
from relight.transport.tracer import PathTracer

BRIGHTNESS = 0.8  # reference brightness of each light at exposure 1, as in training (docs/conventions.md)
BOUNCES = 1
DARKEST = 4e-3  # albedo, as recoloured ones in training
PLACES = 4  # k x k places of a pixel, whose mean the true maps are
MARGIN = 0.06  # about half a person, of the height of the picture

# The camera of the pictures that methods are given. Its tone is plain, as that of the pictures to be matched.
CAMERA = replace(NO_AUGMENTATION, blur=0.7, sharpen=0.5, noise=0.015, jpeg=0.6)


@dataclass(frozen=True)
class Settings:
    """size: pixels of a whole person's picture; samples: paths per pixel; rays: per pixel of the true transport;
    detail, texture: of the figures (relight.figures.dress.make_figure)."""

    size: int = 512
    samples: int = 64
    rays: int = 256
    detail: str = "full"
    texture: int = 1024

    @property
    def side(self) -> int:
        """Pixels of the square on which maps are compared."""
        return self.size // 2


@dataclass
class Picture:
    """shots: the photograph "" and its variants; light, new: panoramas in the camera's frame; maps: true, at the
    photograph's pixels, or None; relit (N,H,W,3) uint8: true pictures in the new lights, black around the figure; seen:
    the truth on the square of the photograph."""

    shots: dict[str, Shot]
    light: Panorama
    new: list[Panorama]
    maps: Maps | None
    relit: np.ndarray
    seen: Intrinsics


def draw(recipe: Recipe, mesh: Mesh, settings: Settings) -> Picture:
    """Draws one picture of an aligned mesh. UserError without Mitsuba."""
    size = settings.size
    baker = Baker(mesh, settings.rays)
    maps = baker.maps(size, PLACES, recipe.view)
    camera = baker.camera(size, recipe.view)
    brightness = BRIGHTNESS * 2**recipe.stops
    light, *new = (panorama(one, recipe.view.pitch, brightness) for one in (recipe.light, *recipe.new))
    glossy = PathTracer(mesh, size, camera, gloss=True)

    def scene(source: Panorama, seed: int) -> np.ndarray:
        return math.pi * glossy.radiance(sky_of(source), settings.samples, BOUNCES, seed)

    coverage = maps.coverage[..., None]
    behind = math.pi * camera_view(light, (size, size))  # as bright as a white matt surface that faces it
    linear = scene(light, 1) + (1 - coverage) * behind
    relit = [to_bytes(encode(scene(one, 2 + i))) for i, one in enumerate(new)]
    # `PathTracer.irradiance` divides by the albedo of the same samples; it costs six times as much.
    matt = math.pi * PathTracer(mesh, size, camera).radiance(sky_of(light), settings.samples, BOUNCES, 0)
    shading = matt / np.maximum(maps.albedo * coverage, DARKEST)
    window = part(maps.mask, recipe.cut)

    def expose(gain: np.ndarray | float) -> np.ndarray:
        """The photograph, always with the same noise."""
        image = torch.from_numpy(np.moveaxis(linear * gain, -1, 0)[None].astype(np.float32))
        taken = developed(image, CAMERA, [np.random.default_rng([recipe.seed, int(recipe.name[-1]), 0xCA])])
        return to_bytes(encode(np.moveaxis(taken[0].numpy(), 0, -1)))[window]

    maps = cropped(maps, window)
    shots = variants(expose, to_bytes(maps.coverage), settings.side)
    shots = {name: shot for name, shot in shots.items() if recipe.varied or not name}
    coefficients = project(light, 2)
    seen = on_square(maps, shading[window], coefficients, shots[""].square)
    return Picture(shots, light, new, maps, np.stack([one[window] for one in relit]), seen)


def part(mask: np.ndarray, cut: float | None) -> tuple[slice, slice]:
    """The part (rows, columns) of a square picture that is kept: all of it, or the upper `cut` of the figure."""
    if cut is None:
        return slice(None), slice(None)
    rows = np.flatnonzero(mask.any(1))
    end = rows[0] + math.ceil(cut * len(rows))
    margin = max(2, round(MARGIN * (end - rows[0])))
    columns = np.flatnonzero(mask[:end].any(0))
    return slice(max(0, rows[0] - margin), end), slice(max(0, columns[0] - margin), columns[-1] + 1 + margin)


def cropped(maps: Maps, window: tuple[slice, slice]) -> Maps:
    """The maps of a part (rows, columns) of the picture."""
    arrays = {name: value[window] for name, value in vars(maps).items() if isinstance(value, np.ndarray)}
    return Maps(**arrays, info=maps.info)


def on_square(maps: Maps, shading: np.ndarray, light: np.ndarray, box: Crop) -> Intrinsics:
    """The truth on a square: means over what of the figure is in each of its pixels."""
    inside, mean = means(maps, box)
    return Intrinsics(inside, mean(maps.albedo), mean(maps.transport), mean(shading), light)


def means(maps: Maps, box: Crop) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Which pixels (S,S) of a square show the figure, and what takes values (H,W,C) to their means over it in each."""
    inside = box.extract(to_bytes(maps.coverage)) >= MASK_THRESHOLD
    known = maps.coverage * maps.mask  # maps are zero where the pixel's centre shows no figure
    share = np.maximum(box.extract(known), 1e-3)[..., None]

    def mean(values: np.ndarray) -> np.ndarray:
        return box.extract(values * known[..., None]) / share * inside[..., None]

    return inside, mean
