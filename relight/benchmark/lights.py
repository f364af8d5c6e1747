"""Panoramas that light the benchmark: rooms, skies, studio lamps and real places, each with its own white balance."""

from dataclasses import dataclass

import numpy as np

from relight.learning.augment import RED_PER_BLUE
from relight.lights.light import Light
from relight.lights.load import GENERATED
from relight.panoramas import Panorama, project, read_panorama
from relight.panoramas.lookup import lookup
from relight.panoramas.polyhaven import NAMES, panorama_file
from relight.panoramas.radiosity import HEIGHT, WIDTH, view_directions
from relight.transport.tracer import sky_directions
from relight.transport.view import View


@dataclass(frozen=True)
class Lamplight:
    """A light.

    Attributes:
        kind: a key of `relight.lights.load.GENERATED`, or `real`.
        seed: random seed of its generator; of a real light, its index in `relight.panoramas.polyhaven.NAMES`.
        tint: ln(B/G) of the white balance.
        yaw: rotation about the vertical, degrees.
    """

    kind: str
    seed: int
    tint: float
    yaw: float


def panorama(light: Lamplight, pitch: float, brightness: float) -> Panorama:
    """Returns a light as a lat-long panorama in the frame of a camera.

    Args:
        light: the light.
        pitch: angle by which the camera looks down, degrees.
        brightness: reference brightness (`Light.normalised`) to which the radiance is scaled.

    Raises:
        UserError: if the light is a real one and the panoramas are not set up.
    """
    upright = Panorama(upright_pixels(light), yaw=light.yaw)
    radiance = lookup(upright, view_directions() @ View(pitch=pitch).rotation)  # camera to world, which is upright
    gains = np.exp([RED_PER_BLUE * light.tint, 0, light.tint])
    pixels = np.maximum(radiance * gains, 0).reshape(HEIGHT, WIDTH, 3)
    unscaled = project(Panorama(pixels), order=2)
    scale = Light(unscaled, light.kind).normalised(brightness).coefficients[0, 1] / unscaled[0, 1]
    return Panorama((pixels * scale).astype(np.float32))


def upright_pixels(light: Lamplight) -> np.ndarray:
    """Returns the radiance (HEIGHT,WIDTH,3) of a light as a lat-long panorama, not yet turned, tinted or scaled.

    Pixels of a real panorama are averaged, so that a sun smaller than a pixel of the result keeps its power.
    """
    if light.kind in GENERATED:
        return GENERATED[light.kind](light.seed)
    pixels = read_panorama(panorama_file(NAMES[light.seed]), repair=True).pixels
    rows, columns = (side // count for side, count in zip(pixels.shape, (HEIGHT, WIDTH)))
    return pixels.reshape(HEIGHT, rows, WIDTH, columns, 3).mean((1, 3))


def resampled(source: Panorama) -> np.ndarray:
    """Returns a panorama resampled to the texels of the path tracer (`sky_directions`)."""
    return lookup(source, sky_directions()).astype(np.float64)
