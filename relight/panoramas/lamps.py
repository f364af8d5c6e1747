"""Panoramas of studios, from integer seeds: one to three large lamps in the dark."""

import numpy as np

from relight.panoramas.color import blackbody, daylight
from relight.panoramas.radiosity import HEIGHT, WIDTH, view_directions

STREAM = 0x1A35  # keeps these random numbers apart from those of other generators with the same seed
SOFT_RIM = np.radians(3)  # width in which a lamp's rim fades: about a pixel


def generate_lamps(seed: int) -> np.ndarray:
    """Generates the panorama of a dark studio with lamps of 4 to 25 degrees radius.

    Returns:
        (64,128,3) float32 lat-long, linear, -z at the centre, samples at pixel centres.
    """
    rng = np.random.default_rng([seed, STREAM])
    directions = view_directions()
    # The walls reflect a little of the light, slightly warm.
    image = np.exp(rng.uniform(*np.log([0.02, 0.3]))) * np.array([1.0, 0.95, 0.9]) * np.ones((len(directions), 3))
    for _ in range(rng.integers(1, 4)):
        azimuth, elevation = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(-20, 70))
        toward = [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)]
        radius = np.radians(np.exp(rng.uniform(*np.log([4, 25]))))  # of the lamp, as an angle
        color = blackbody(rng.uniform(2600, 4500)) if rng.random() < 0.6 else daylight(rng.uniform(5000, 9000))
        angle = np.arccos(np.clip(directions @ toward, -1, 1))
        cover = np.clip((radius - angle) / SOFT_RIM + 0.5, 0, 1)  # of each pixel by the lamp
        image += cover[:, None] * color * rng.uniform(0.3, 1) / (1 - np.cos(radius))  # power does not depend on radius
    return image.reshape(HEIGHT, WIDTH, 3).astype(np.float32)
