"""Outdoor panoramas from integer seeds.

The sky's luminance is that of the CIE general sky (Kittler, Perez, Darula 1998; ISO 15469), with a sun that the
atmosphere attenuates. Both light the ground and the objects on the horizon. There are overcast, broken, hazy and clear
skies, with the sun 3 to 70 degrees high.
"""

import numpy as np

from relight.panoramas.color import blackbody, daylight, luminance
from relight.panoramas.radiosity import HEIGHT, WIDTH, pixel_solid_angles, view_directions

STREAM = 0x5C1  # keeps these random numbers apart from those of other generators with the same seed
# Parameters of standard skies of ISO 15469: gradation a, b and scattering c, d, e.
SKIES = {
    "overcast": (4.0, -0.70, 0.0, -1.0, 0.0),
    "broken": (0.0, -1.0, 5.0, -2.5, 0.30),
    "hazy": (-1.0, -0.55, 10.0, -3.0, 0.45),
    "clear": (-1.0, -0.32, 10.0, -3.0, 0.45),
}
BEAM = {"overcast": 0.0, "broken": 0.35, "hazy": 0.55, "clear": 0.85}  # share of the sun's beam that a sky transmits
PROBABILITIES = (0.25, 0.25, 0.2, 0.3)  # of SKIES


def generate_sky(seed: int) -> np.ndarray:
    """Generates the panorama of a sky.

    Returns:
        (64,128,3) float32 lat-long, linear, -z at the centre, samples at pixel centres.
    """
    rng = np.random.default_rng([seed, STREAM])
    kind = list(SKIES)[rng.choice(len(SKIES), p=PROBABILITIES)]
    direction = view_directions()
    solid_angle = pixel_solid_angles()
    elevation, azimuth = np.radians(rng.uniform(3, 70)), rng.uniform(0, 2 * np.pi)
    sun = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    image = _sky_radiance(rng, kind, direction, sun)
    sun_irradiance = _draw_sun_irradiance(rng, kind, elevation)
    skyline_height = _draw_skyline(rng, direction)

    above = direction[:, 1] > 0
    sky_irradiance = (image * (np.maximum(direction[:, 1], 0) * solid_angle * above)[:, None]).sum(0)
    ground_irradiance = sky_irradiance
    sun_pixel = (direction @ sun).argmax()
    if direction[sun_pixel, 1] > skyline_height[sun_pixel]:
        image[sun_pixel] += sun_irradiance / solid_angle[sun_pixel]
        ground_irradiance = sky_irradiance + sun_irradiance * sun[1]
    grey = np.exp(rng.uniform(np.log(0.06), np.log(0.35)))
    ground_albedo = grey * np.array([rng.uniform(0.85, 1.15), 1.0, rng.uniform(0.55, 1.0)])
    image[~above] = ground_albedo / np.pi * ground_irradiance
    # Objects on the horizon are vertical: half the sky lights them, and the sun their side toward the camera.
    is_object = above & (direction[:, 1] <= skyline_height)
    sun_cosine = np.maximum(-direction[is_object] * [1, 0, 1] @ sun, 0)[:, None]
    object_irradiance = 0.5 * sky_irradiance + 0.3 * image[~above][0] * np.pi + sun_cosine * sun_irradiance
    image[is_object] = rng.uniform(0.08, 0.4) / np.pi * object_irradiance

    exposure = np.exp(rng.normal(np.log(0.28), 0.4)) / luminance((image * solid_angle[:, None]).sum(0) / (4 * np.pi))
    return (image * exposure).reshape(HEIGHT, WIDTH, 3).astype(np.float32)


def _sky_radiance(rng: np.random.Generator, kind: str, direction: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Returns the radiance (N,3) of the sky without the sun, for an illuminance of 1 on the ground before clouds.

    `kind` is a key of SKIES, and `direction` (N,3) that of `view_directions`.
    """
    a, b, c, d, e = SKIES[kind]
    sine = np.maximum(direction[:, 1], 0.02)  # of the elevation
    sun_angle = np.arccos(np.clip(direction @ sun, -1, 1))
    gradation = 1 + a * np.exp(b / sine)
    scattering = 1 + c * (np.exp(d * sun_angle) - np.exp(d * np.pi / 2)) + e * np.cos(sun_angle) ** 2
    radiance = np.maximum(gradation * scattering, 0.02)
    radiance /= (radiance * sine * pixel_solid_angles())[direction[:, 1] > 0].sum()
    if kind == "broken":
        cover = _draw_clouds(rng, direction)
        radiance = radiance * (1 - 0.6 * cover) + 0.55 * cover * (0.6 + 0.8 * np.exp(-2 * sun_angle)) / np.pi
    height = sine[:, None] ** 0.5  # blue overhead, pale near the horizon and around the sun
    blue = daylight(12000) * (0.55 + 0.45 * height) + daylight(6000) * (0.45 - 0.45 * height)
    white = 1.0 if kind == "overcast" else np.clip(1.1 * np.exp(-2.5 * sun_angle), 0, 1)[:, None]
    return radiance[:, None] * (blue * (1 - white) + daylight(6300) * white)


def _draw_sun_irradiance(rng: np.random.Generator, kind: str, elevation: float) -> np.ndarray:
    """Draws the irradiance (3,) of the sun on a facing surface, over the illuminance of the sky on the ground.

    It is about 5 at noon and 0 at the horizon, where the air mass (Kasten 1965) is largest and the color warmest.
    """
    air_mass = 1 / (np.sin(elevation) + 0.15 * (np.degrees(elevation) + 3.885) ** -1.253)
    strength = 7 * BEAM[kind] * np.exp(-0.21 * air_mass) * rng.uniform(0.6, 1.2)
    return blackbody(2200 + 3400 * (1 - np.exp(-np.degrees(elevation) / 16))) * strength


def _draw_clouds(rng: np.random.Generator, direction: np.ndarray) -> np.ndarray:
    """Draws the cloud cover (N,) in [0,1] of directions (N,3): octaves of random waves on a plane overhead."""
    position = direction[:, [0, 2]] / np.maximum(direction[:, 1:2], 0.06)
    height = np.zeros(len(position))
    for octave in range(5):
        for _ in range(4):
            heading, phase = rng.uniform(0, 2 * np.pi, 2)
            wave = position @ np.array([np.cos(heading), np.sin(heading)]) * 1.1 * 1.8**octave  # radians
            height += np.sin(wave + phase) / 1.7**octave
    return 1 / (1 + np.exp(-2.5 * (height + rng.uniform(-0.8, 0.8))))


def _draw_skyline(rng: np.random.Generator, direction: np.ndarray) -> np.ndarray:
    """Draws a skyline of up to 13 blocks: the sine (N,) of its elevation at the azimuth of each direction (N,3)."""
    azimuth = np.arctan2(direction[:, 0], direction[:, 2])
    height = np.full(len(azimuth), 0.01)
    for _ in range(rng.integers(0, 14)):
        centre, half_width, top = rng.uniform(-np.pi, np.pi), rng.uniform(0.05, 0.4), rng.uniform(0.03, 0.5)
        distance = np.abs((azimuth - centre + np.pi) % (2 * np.pi) - np.pi)
        height = np.where(distance < half_width, np.maximum(height, top), height)
    return height
