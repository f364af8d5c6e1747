"""Outdoor panoramas from integer seeds.

The luminance is that of the CIE general sky (Kittler, Perez, Darula 1998; ISO 15469), with a sun that the atmosphere
attenuates; skyline and ground are lit by both. There are overcast, broken, hazy and clear days, with the sun 3 to 70
degrees high.
"""

import numpy as np

from relight.panoramas.colour import blackbody, daylight, luminance
from relight.panoramas.projection import latlong_solid_angles
from relight.panoramas.radiosity import HEIGHT, WIDTH, view_directions

# Standard skies of ISO 15469: gradation a, b and scattering c, d, e; then the share of the sun's beam that passes.
SKIES = {
    "overcast": ((4.0, -0.70, 0.0, -1.0, 0.0), 0.0),
    "broken": ((0.0, -1.0, 5.0, -2.5, 0.30), 0.35),
    "hazy": ((-1.0, -0.55, 10.0, -3.0, 0.45), 0.55),
    "clear": ((-1.0, -0.32, 10.0, -3.0, 0.45), 0.85),
}
ODDS = (0.25, 0.25, 0.2, 0.3)


def generate_sky(seed: int) -> np.ndarray:
    """Generates the panorama of a sky.

    Returns:
        (64,128,3) float32 lat-long, linear, -z at the centre, samples at pixel centres.
    """
    rng = np.random.default_rng([seed, 0x5C1])
    kind = list(SKIES)[rng.choice(len(SKIES), p=ODDS)]
    (a, b, c, d, e), beam = SKIES[kind]
    direction = view_directions()
    weight = np.repeat(latlong_solid_angles(HEIGHT, WIDTH), WIDTH)
    elevation, azimuth = np.radians(rng.uniform(3, 70)), rng.uniform(0, 2 * np.pi)
    sun = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])

    high = np.maximum(direction[:, 1], 0.02)
    angle = np.arccos(np.clip(direction @ sun, -1, 1))
    gradation = 1 + a * np.exp(b / high)
    scattering = 1 + c * (np.exp(d * angle) - np.exp(d * np.pi / 2)) + e * np.cos(angle) ** 2
    bright = np.maximum(gradation * scattering, 0.02)
    above = direction[:, 1] > 0
    bright /= (bright * high * weight)[above].sum()  # illuminance of 1 on the ground
    if kind == "broken":
        cover = clouds(rng, direction)
        bright = bright * (1 - 0.6 * cover) + 0.55 * cover * (0.6 + 0.8 * np.exp(-2 * angle)) / np.pi
    up = high[:, None] ** 0.5
    blue = daylight(12000) * (0.55 + 0.45 * up) + daylight(6000) * (0.45 - 0.45 * up)
    white = 1.0 if kind == "overcast" else np.clip(1.1 * np.exp(-2.5 * angle), 0, 1)[:, None]
    image = bright[:, None] * (blue * (1 - white) + daylight(6300) * white)

    # Illuminance of the beam on a facing surface over that of the sky on the ground: about 5 at noon, 0 at the horizon.
    air = 1 / (np.sin(elevation) + 0.15 * (np.degrees(elevation) + 3.885) ** -1.253)
    strength = 7 * beam * np.exp(-0.21 * air) * rng.uniform(0.6, 1.2)
    shine = blackbody(2200 + 3400 * (1 - np.exp(-np.degrees(elevation) / 16))) * strength
    horizon = skyline(rng, direction)
    visible = direction @ sun
    lit_sky = (image * (np.maximum(direction[:, 1], 0) * weight * above)[:, None]).sum(0)
    sun_pixel = visible.argmax()
    if direction[sun_pixel, 1] > horizon[sun_pixel]:
        image[sun_pixel] += shine / weight[sun_pixel]
        ground_light = lit_sky + shine * sun[1]
    else:
        ground_light = lit_sky
    ground = np.exp(rng.uniform(np.log(0.06), np.log(0.35))) * np.array(
        [rng.uniform(0.85, 1.15), 1.0, rng.uniform(0.55, 1.0)]
    )
    image[~above] = ground / np.pi * ground_light
    # What stands on the horizon is upright: lit by half the sky, and by the beam on its side toward the camera.
    hidden = above & (direction[:, 1] <= horizon)
    facing = np.maximum(-direction[hidden] * [1, 0, 1] @ sun, 0)[:, None]
    image[hidden] = rng.uniform(0.08, 0.4) / np.pi * (0.5 * lit_sky + 0.3 * image[~above][0] * np.pi + facing * shine)

    exposure = np.exp(rng.normal(np.log(0.28), 0.4)) / luminance((image * weight[:, None]).sum(0) / (4 * np.pi))
    return (image * exposure).reshape(HEIGHT, WIDTH, 3).astype(np.float32)


def clouds(rng: np.random.Generator, direction: np.ndarray) -> np.ndarray:
    """Draws the cover (N,) in [0,1] of clouds on a plane above, as a few octaves of random waves."""
    place = direction[:, [0, 2]] / np.maximum(direction[:, 1:2], 0.06)
    height = np.zeros(len(place))
    for octave in range(5):
        for _ in range(4):
            heading, phase = rng.uniform(0, 2 * np.pi, 2)
            wave = place @ np.array([np.cos(heading), np.sin(heading)]) * 1.1 * 1.8**octave
            height += np.sin(wave + phase) / 1.7**octave
    cover = rng.uniform(-0.8, 0.8)
    return 1 / (1 + np.exp(-2.5 * (height + cover)))


def skyline(rng: np.random.Generator, direction: np.ndarray) -> np.ndarray:
    """Draws the height (N,) of the skyline in each direction, as sine of the elevation."""
    azimuth = np.arctan2(direction[:, 0], direction[:, 2])
    height = np.full(len(azimuth), 0.01)
    for _ in range(rng.integers(0, 14)):
        centre, half, top = rng.uniform(-np.pi, np.pi), rng.uniform(0.05, 0.4), rng.uniform(0.03, 0.5)
        away = np.abs((azimuth - centre + np.pi) % (2 * np.pi) - np.pi)
        height = np.where(away < half, np.maximum(height, top), height)
    return height
