"""Generates the panoramas that light the benchmark: rooms, skies and studio lamps, each with its own white balance."""

from dataclasses import dataclass

import numpy as np

from relight.learning.augment import RED_PER_BLUE
from relight.lights.light import Light
from relight.panoramas import Panorama, generate_room, generate_sky, project
from relight.panoramas.colour import blackbody, daylight
from relight.panoramas.radiosity import HEIGHT, WIDTH, view_directions
from relight.photos.environment import lookup
from relight.transport.tracer import sky_directions
from relight.transport.view import View


@dataclass(frozen=True)
class Lamplight:
    """A generated light.

    Attributes:
        kind: a key of KINDS.
        seed: of its generator.
        tint: ln(B/G) of the white balance.
        yaw: rotation about the vertical, degrees.
    """

    kind: str
    seed: int
    tint: float
    yaw: float


def lamps(seed: int) -> np.ndarray:
    """Returns a dark studio with one to three large lamps: a lat-long panorama (64,128,3) float32, linear."""
    rng = np.random.default_rng([seed, 0x1A35])
    directions = view_directions()
    image = np.exp(rng.uniform(*np.log([0.02, 0.3]))) * np.array([1.0, 0.95, 0.9]) * np.ones((len(directions), 3))
    for _ in range(rng.integers(1, 4)):
        azimuth, elevation = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(-20, 70))
        toward = [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)]
        radius = np.radians(np.exp(rng.uniform(*np.log([4, 25]))))
        colour = blackbody(rng.uniform(2600, 4500)) if rng.random() < 0.6 else daylight(rng.uniform(5000, 9000))
        inside = np.clip((radius - np.arccos(np.clip(directions @ toward, -1, 1))) / np.radians(3) + 0.5, 0, 1)
        image += inside[:, None] * colour * rng.uniform(0.3, 1) / (1 - np.cos(radius))
    return image.reshape(HEIGHT, WIDTH, 3).astype(np.float32)


KINDS = {"room": generate_room, "sky": generate_sky, "lamps": lamps}


def panorama(light: Lamplight, pitch: float, brightness: float) -> Panorama:
    """Returns a light as a lat-long panorama in the frame of a camera that looks down by `pitch` degrees.

    Its radiance is scaled so that the reference brightness (`Light.normalised`) is `brightness`.
    """
    upright = Panorama(KINDS[light.kind](light.seed), yaw=light.yaw)
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
