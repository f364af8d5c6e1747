"""Renders one picture of the benchmark: a path-traced figure as a camera takes it, with its ground truth."""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch

from relight.benchmark.lights import panorama, resampled
from relight.benchmark.measures import Intrinsics
from relight.benchmark.recipes import PictureRecipe
from relight.benchmark.shots import Shot, variants
from relight.core.srgb import encode, to_bytes
from relight.learning.camera import Camera, simulate_camera
from relight.maps import Maps
from relight.maps.square import Crop, extent, figure_means
from relight.meshes import Mesh
from relight.panoramas import Panorama, project
from relight.photos.backdrop import camera_view
from relight.settings import read_preset
from relight.transport import Baker
from relight.transport.tracer import PathTracer

BRIGHTNESS = 0.8  # reference brightness of lights at exposure 1, as in training (docs/conventions.md)
BOUNCES = 1
MIN_ALBEDO = 4e-3  # as of recolored garments in training
CAMERA_STREAM = 0xCA  # of random numbers, so that noise is independent of other draws
SUPERSAMPLE = 4  # k: true maps are means over k x k points of a pixel
MARGIN = 0.06  # around half a person, as a fraction of the picture's height

# The camera of the photographs. It has no tone curve, as the true pictures have none.
CAMERA = Camera(tone=0.0, blur=0.7, sharpen=0.5, noise=0.015, jpeg=0.6)


@dataclass(frozen=True)
class Settings:
    """How pictures are rendered.

    Attributes:
        size: side of the picture of a whole person, pixels.
        samples: paths per pixel.
        rays: per pixel, for the true transport.
        detail, texture: of the figures (`relight.figures.make.make_figure`).
    """

    size: int = 512
    samples: int = 64
    rays: int = 256
    detail: str = "full"
    texture: int = 1024

    @property
    def side(self) -> int:
        """Side of the square on which maps are compared, pixels."""
        return self.size // 2


@dataclass
class Picture:
    """A picture with its ground truth.

    Attributes:
        shots: the photograph, under "", and its variants by name.
        light: light of the photograph, in the camera's frame.
        new: the N new lights, in the camera's frame.
        maps: ground truth at the photograph's pixels.
        relit: (N,H,W,3) uint8, true pictures in the new lights, black around the figure.
        truth: ground truth on the square of the photograph.
    """

    shots: dict[str, Shot]
    light: Panorama
    new: list[Panorama]
    maps: Maps
    relit: np.ndarray
    truth: Intrinsics


def render_picture(recipe: PictureRecipe, mesh: Mesh, settings: Settings) -> Picture:
    """Renders one picture of a recipe's figure, aligned, with its variants and its ground truth.

    Raises:
        UserError: without Mitsuba.
    """
    size = settings.size
    baker = scene_baker(mesh, settings)
    maps, camera = baker.maps(recipe.view), baker.camera(recipe.view)
    brightness = BRIGHTNESS * 2**recipe.stops
    light, *new = (panorama(source, recipe.view.pitch, brightness) for source in (recipe.light, *recipe.new))
    tracer = PathTracer(mesh, size, camera, gloss=True)

    def render(source: Panorama, seed: int) -> np.ndarray:
        """Returns the figure (S,S,3), linear, in a panorama: pi times the radiance, so that white shows the shading."""
        return math.pi * tracer.radiance(resampled(source), settings.samples, BOUNCES, seed)

    coverage = maps.coverage[..., None]
    background = math.pi * camera_view(light, (size, size))  # as bright as a white diffuse surface that faces it
    linear = render(light, seed=1) + (1 - coverage) * background
    relit = [to_bytes(encode(render(source, seed=2 + i))) for i, source in enumerate(new)]
    diffuse = math.pi * PathTracer(mesh, size, camera).radiance(resampled(light), settings.samples, BOUNCES, seed=0)
    shading = diffuse / np.maximum(maps.albedo * coverage, MIN_ALBEDO)
    window = crop_window(maps.mask, recipe.cut)

    def expose(gain: np.ndarray | float) -> np.ndarray:
        """Returns the photograph (H,W,3) uint8 at a gain, a number or (3,); the noise is always the same."""
        image = torch.from_numpy(np.moveaxis(linear * gain, -1, 0)[None].astype(np.float32))
        noise = np.random.default_rng([recipe.seed, int(recipe.name[-1]), CAMERA_STREAM])
        photo = simulate_camera(image, CAMERA, [noise])
        return to_bytes(encode(np.moveaxis(photo[0].numpy(), 0, -1)))[window]

    maps = crop_maps(maps, window)
    shots = variants(expose, to_bytes(maps.coverage), settings.side)
    shots = {name: shot for name, shot in shots.items() if recipe.varied or not name}
    truth = on_square(maps, shading[window], project(light, order=2), shots[""].square)
    return Picture(shots, light, new, maps, np.stack([source[window] for source in relit]), truth)


def scene_baker(mesh: Mesh, settings: Settings, order: int = 2) -> Baker:
    """Returns the baker of the true maps of a figure."""
    quality = {"size": settings.size, "rays": settings.rays, "supersample": SUPERSAMPLE}
    return Baker(mesh, replace(read_preset("bake"), order=order, **quality))


def crop_window(mask: np.ndarray, cut: float | None) -> tuple[slice, slice]:
    """Returns the rows and the columns of a picture to keep.

    Args:
        mask: (S,S) bool of the figure.
        cut: fraction of its height that is kept, from the top, with a MARGIN around it; None for the whole picture.
    """
    if cut is None:
        return slice(None), slice(None)
    (top, bottom), _ = extent(mask)
    end = top + math.ceil(cut * (bottom - top))
    margin = max(2, round(MARGIN * (end - top)))
    left, right = extent(mask[:end])[1]
    return slice(max(0, top - margin), end), slice(max(0, left - margin), right + margin)


def crop_maps(maps: Maps, window: tuple[slice, slice]) -> Maps:
    """Returns maps cropped to a window: its rows and its columns."""
    arrays = {name: value[window] for name, value in vars(maps).items() if isinstance(value, np.ndarray)}
    return Maps(**arrays, info=maps.info)


def on_square(maps: Maps, shading: np.ndarray, light: np.ndarray, box: Crop) -> Intrinsics:
    """Returns the ground truth on a square of a picture: means over the figure in each of its pixels.

    Maps and `shading` (H,W,3), linear, are at the photograph's pixels; `light` (9,3) has radiance coefficients.
    """
    inside, mean = figure_means(maps.coverage, maps.mask, box)
    return Intrinsics(inside, mean(maps.albedo), mean(maps.transport), mean(shading), light)
