"""Generates the panoramas that light the benchmark: rooms, skies and studio lamps, each with its own white balance."""

from dataclasses import dataclass

import numpy as np

from relight.learning.augment import RED_PER_BLUE
from relight.lights.chain import GENERATORS
from relight.lights.light import Light
from relight.panoramas import Panorama, project
from relight.panoramas.radiosity import HEIGHT, WIDTH, view_directions
from relight.photos.compose.environment import lookup
from relight.transport.tracer import sky_directions
from relight.transport.view import View


@dataclass(frozen=True)
class Lamplight:
    """A generated light.

    Attributes:
        kind: a key of `relight.lights.chain.GENERATORS`.
        seed: random seed of its generator.
        tint: ln(B/G) of the white balance.
        yaw: rotation about the vertical, degrees.
    """

    kind: str
    seed: int
    tint: float
    yaw: float


def panorama(light: Lamplight, pitch: float, brightness: float) -> Panorama:
    """Returns a light as a lat-long panorama in the frame of a camera that looks down by `pitch` degrees.

    Its radiance is scaled so that the reference brightness (`Light.normalised`) is `brightness`.
    """
    upright = Panorama(GENERATORS[light.kind](light.seed), yaw=light.yaw)
    radiance = lookup(upright, view_directions() @ View(pitch=pitch).rotation)  # camera to world, which is upright
    gains = np.exp([RED_PER_BLUE * light.tint, 0, light.tint])
    pixels = np.maximum(radiance * gains, 0).reshape(HEIGHT, WIDTH, 3)
    source = f"{light.kind}:{light.seed}"
    before = project(Panorama(pixels), 2)
    scale = Light(before, source).normalised(brightness).coefficients[0, 1] / before[0, 1]
    return Panorama((pixels * scale).astype(np.float32), source=source)


def resampled(source: Panorama) -> np.ndarray:
    """Returns a panorama resampled to the texels of the path tracer (`sky_directions`)."""
    return lookup(source, sky_directions()).astype(np.float64)
