"""Lights of places by name: an ordinary photograph without a person, and where its light comes from if that is known.

place:street.jpg            the light of the place in the photograph (relight.lights.place)
place:street.jpg@-60,40     most of it comes from 60 degrees to the left of the camera, 40 up; without the 40, 45 up
"""

import re
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.lights import Light
from relight.lights.light import direction, parts_of
from relight.lights.load import parse_number
from relight.lights.place import place_light
from relight.photos.color import on_white
from relight.photos.opening import is_picture
from relight.photos.picture import Picture

PREFIX = "place:"
STATED = re.compile(r"(.+)@([-+.0-9]+)(?:,([-+.0-9]+))?")
ELEVATION = 45  # degrees, where none is stated; the median of 18 real places is 51


def is_of_person(light: str) -> bool:
    """Returns whether the name of a light is that of a photo of somebody, whose light it is."""
    return is_picture(light) and not light.startswith(PREFIX) and len(parts_of(light)) == 1


def split_place(text: str) -> tuple[str, tuple[str, str | None] | None]:
    """Splits the name of a place's light, such as "place:street.jpg@30,10", with or without its prefix.

    Returns:
        The file, and the two numbers after the @ as text, the second None if left out; or None if there is no @.
    """
    text = text.removeprefix(PREFIX)
    match = None if Path(text).is_file() else STATED.fullmatch(text)
    return (match[1], (match[2], match[3])) if match else (text, None)


def light(text: str, order: int = 2) -> Light:
    """Reads the light of a place, for `relight.lights.load_light`.

    Args:
        text: as above, without PREFIX. The picture lies behind the person.
        order: of the spherical harmonics; bands above 2 are zero.

    Returns:
        The light, in units of the picture's linear values; a note says that it is an estimate.

    Raises:
        UserError: if the file is no photo, or the direction is none.
    """
    source = f"{PREFIX}{text}"
    path, stated = split_place(text)
    if not is_picture(path):
        raise UserError(f"{source}: {path} is no photograph of a place: give a JPEG, PNG, WebP or TIFF")
    if not stated:
        return estimated(on_white(Picture.of(path, "place").rgba), path).at_order(order)
    azimuth, elevation = (parse_number(number or str(ELEVATION), source) for number in stated)
    toward = direction(azimuth, elevation, source)
    return Light(place_light(on_white(Picture.of(path, "place").rgba), toward), source).at_order(order)


def estimated(codes: np.ndarray, name: str) -> Light:
    """Returns the light of the place in a picture (h,w,3) uint8 sRGB, with a note that it is an estimate."""
    known = f"if you know where it comes from, give --light {PREFIX}{name}@-60,40 (60 degrees left, 40 up)"
    return Light(place_light(codes), f"{PREFIX}{name}", notes=[f"the light is estimated from {name}: {known}"])
