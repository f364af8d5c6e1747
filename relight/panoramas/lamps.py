"""Panoramas of studios, from integer seeds: one to three large lamps in the dark."""

import numpy as np

from relight.panoramas.color import blackbody, daylight
from relight.panoramas.radiosity import HEIGHT, WIDTH, view_directions


def generate_lamps(seed: int) -> np.ndarray:
    """Generates the panorama of a dark studio with lamps of 4 to 25 degrees radius.

    Returns:
        (64,128,3) float32 lat-long, linear, -z at the centre, samples at pixel centres.
    """
    rng = np.random.default_rng([seed, 0x1A35])
    directions = view_directions()
    image = np.exp(rng.uniform(*np.log([0.02, 0.3]))) * np.array([1.0, 0.95, 0.9]) * np.ones((len(directions), 3))
    for _ in range(rng.integers(1, 4)):
        azimuth, elevation = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(-20, 70))
        toward = [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)]
        radius = np.radians(np.exp(rng.uniform(*np.log([4, 25]))))
        color = blackbody(rng.uniform(2600, 4500)) if rng.random() < 0.6 else daylight(rng.uniform(5000, 9000))
        inside = np.clip((radius - np.arccos(np.clip(directions @ toward, -1, 1))) / np.radians(3) + 0.5, 0, 1)
        image += inside[:, None] * color * rng.uniform(0.3, 1) / (1 - np.cos(radius))
    return image.reshape(HEIGHT, WIDTH, 3).astype(np.float32)
