"""The light of a place, from an ordinary photograph of it in which most of the sphere is out of sight.

It is the mean light of places, tinted by half of the picture's color (in logarithms), and changed linearly with a few
features of the picture, mostly toward its brighter side. If it is known where the light comes from, it is a soft lamp
there and even light instead. `tools/places.py` of commit bd623a7f fitted both.

place:street.jpg            the light of the place in the photograph
place:street.jpg@-60,40     most of it comes from 60 degrees to the left of the camera, 40 up; without the 40, 45 up
"""

import json
import os
import re
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.srgb import LINEAR
from relight.lights.light import Light, direction, parts_of
from relight.panoramas import luminance
from relight.pictures.codes import on_white
from relight.pictures.opening import is_picture
from relight.pictures.picture import Picture
from relight.sh import bands, basis, cosine_factors, per_coefficient

# What is known of the lights of places. light: (7,27) radiance of the mean light, and its change with each feature of
# `features`, before the tint. limits: (6,2) of the features, beyond which nothing was measured. lamp: (3,) factors of
# even light, and of bands 1 and 2 of the lamp. level: norm of the irradiance over the picture's mean luminance.
STATISTICS = Path(__file__).with_name("place.json")
SIDE = 48  # pixels of the picture's longer side that are looked at
TINT = 0.5  # power of the picture's color that the light takes on
WHITE = 0.98  # linear values above it count as clipped
FLOOR = 1e-3  # least linear value of a mean, and least contrast
IRRADIANCE = per_coefficient(cosine_factors(2))[:, None]  # (9,1) factors from radiance to irradiance
PREFIX = "place:"
STATED = re.compile(r"(.+)@([-+.0-9]+)(?:,([-+.0-9]+))?")
ELEVATION = 45  # degrees, where none is stated; the median of 18 real places is 51


def place_light(codes: np.ndarray, toward: np.ndarray | None = None) -> np.ndarray:
    """Estimates the light of a place.

    Args:
        codes: (h,w,3) uint8 sRGB, a photograph of it. The camera looks along -z and is level.
        toward: (3,) unit vector to where most light comes from, if that is known (relight.lights.light.direction).

    Returns:
        The light (9,3): radiance in units of the picture's linear values.
    """
    known = json.loads(STATISTICS.read_text(encoding="utf-8"))
    picture = thumbnail(codes)
    if toward is None:
        weights = np.append(1, np.clip(features(picture), *np.transpose(known["limits"])))  # of the mean and changes
        grey_light = np.tensordot(weights, np.reshape(known["light"], (-1, 9, 3)), 1)
    else:
        grey_light = (_lamp_parts(toward) @ known["lamp"])[:, None]
    light = grey_light * tint(picture)
    norm = float(np.linalg.norm(light * IRRADIANCE))
    return light * (known["level"] * max(float(luminance(picture).mean()), FLOOR) / norm)


def thumbnail(codes: np.ndarray) -> np.ndarray:
    """Returns a picture (h,w,3) uint8 sRGB as linear values, its longer side scaled down to SIDE.

    The codes are averaged, not linear values, so that a small bright lamp does not outweigh the rest; the constants of
    this module were fitted to such pictures.
    """
    height, width = codes.shape[:2]
    scale = min(SIDE / max(height, width), 1)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    return LINEAR[np.asarray(Image.fromarray(codes).resize(size, Image.Resampling.BOX))].astype(np.float64)


def tint(picture: np.ndarray) -> np.ndarray:
    """Returns the color (3,) that the light takes on from a picture (h,w,3), linear; grey has 1."""
    mean = np.maximum(picture.mean((0, 1)), FLOOR)
    return (mean / luminance(mean)) ** TINT


def features(picture: np.ndarray) -> np.ndarray:
    """Returns what the light depends on (6,): measures of a picture (h,w,3), linear.

    Balances, from -1 to 1, of right against left and of top against bottom; share of clipped pixels; logarithm of the
    luminance's deviation over its mean; ln(R/G) and ln(B/G) of the mean.
    """
    light = luminance(picture)
    mean = max(float(light.mean()), FLOOR)
    across, down = (np.linspace(-1, 1, n) if n > 1 else np.zeros(1) for n in light.shape[::-1])
    red, green, blue = np.log(np.maximum(picture.mean((0, 1)), FLOOR))
    return np.array([
        (light.mean(0) * across).mean() / mean,
        -(light.mean(1) * down).mean() / mean,
        (picture.max(-1) > WHITE).mean(),
        np.log(max(float(light.std()) / mean, FLOOR)),
        red - green,
        blue - green,
    ])  # fmt: skip


def _lamp_parts(toward: np.ndarray) -> np.ndarray:
    """Returns the parts (...,9,3) that mix a lamp's light, seen along `toward` (...,3): even light, bands 1 and 2."""
    even, first, second = (bands(2) == band for band in range(3))
    lamp = basis(toward, 2)
    return np.stack(np.broadcast_arrays(even, lamp * first, lamp * second), -1)


def is_of_person(light: str) -> bool:
    """Returns whether the name of a light is that of a photo of somebody, whose light it is."""
    return is_picture(light) and not light.startswith(PREFIX) and len(parts_of(light)) == 1


def split_place(text: str) -> tuple[str, tuple[str, str | None] | None]:
    """Splits the name of a place's light, such as "place:street.jpg@30,10", with or without its prefix.

    Returns:
        The file, and the two numbers after the @ as text, the second None if left out; or None if there is no @.
    """
    text = text.removeprefix(PREFIX)
    match = None if os.path.isfile(text) else STATED.fullmatch(text)
    return (match[1], (match[2], match[3])) if match else (text, None)


def read_place(text: str, order: int = 2) -> Light:
    """Reads the light of a place, for `relight.lights.load_light`.

    Args:
        text: as above, without PREFIX. The picture lies behind the person.
        order: of the spherical harmonics; bands above 2 are zero.

    Returns:
        The light, in units of the picture's linear values; a note says that it is an estimate.

    Raises:
        UserError: if the file is not a photo, or the direction not valid.
    """
    source = f"{PREFIX}{text}"
    path, stated = split_place(text)
    if not is_picture(path):
        raise UserError(f"{source}: {path} is no photograph of a place: give a JPEG, PNG, WebP or TIFF")
    if not stated:
        return estimated(on_white(Picture.of(path, "place").rgba), path).at_order(order)
    azimuth, elevation = stated
    toward = direction(azimuth, elevation or ELEVATION, source)
    return Light(place_light(on_white(Picture.of(path, "place").rgba), toward), source).at_order(order)


def estimated(codes: np.ndarray, name: str) -> Light:
    """Returns the light of the place in a picture (h,w,3) uint8 sRGB, with a note that it is an estimate."""
    known = f"if you know where it comes from, give --light {PREFIX}{name}@-60,40 (60 degrees left, 40 up)"
    return Light(place_light(codes), f"{PREFIX}{name}", notes=[f"the light is estimated from {name}: {known}"])
