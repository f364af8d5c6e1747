"""Lights of places by name: an ordinary photograph without a person, and where its light comes from if that is known.

place:street.jpg            the light of the place in the photograph (relight.lights.place)
place:street.jpg@-60,40     most of it comes from 60 degrees to the left of the camera, 40 up; without the 40, 45 up
"""

import re
from pathlib import Path
from typing import Unpack

from relight.errors import UserError
from relight.lights import Light, LightOptions, load_light
from relight.lights.light import direction
from relight.lights.load import parse_number
from relight.lights.place import place_light
from relight.panoramas import orient
from relight.photos.infer import AUTO
from relight.photos.read import is_picture, read_photo

PREFIX = "place:"
STATED = re.compile(r"(.+)@([-+.0-9]+)(?:,([-+.0-9]+))?")
ELEVATION = 45  # degrees, where none is stated; the median of 18 real places is 51


def default_light(background: str) -> str:
    """Returns the light that `auto` means: that of the place in the background if this is a picture, else AUTO."""
    return f"{PREFIX}{background}" if is_picture(background) else AUTO


def split_place(text: str) -> tuple[str, tuple[str, str | None] | None]:
    """Splits the name of a place's light, with or without PREFIX, into its file and the two numbers of a direction."""
    text = text.removeprefix(PREFIX)
    match = None if Path(text).is_file() else STATED.fullmatch(text)
    return (match[1], (match[2], match[3])) if match else (text, None)


def read_place(text: str, order: int = 2, yaw: float = 0.0, flip: bool = False) -> Light:
    """Reads the light of a place.

    Args:
        text: as above, with or without PREFIX.
        order: of the spherical harmonics; bands above 2 are zero.
        yaw: degrees of rotation about the vertical, from +z toward +x. At 0 the picture lies behind the person.
        flip: mirrors left and right, before the rotation.

    Returns:
        The light, in units of the picture's linear values; a note says that it is an estimate.

    Raises:
        UserError: if the file is no photo, or the direction is none.
    """
    path, stated = split_place(text)
    if not is_picture(path):
        raise UserError(f"{text}: {path} is no photograph of a place: give a JPEG, PNG, WebP or TIFF")
    source, toward = f"{PREFIX}{text.removeprefix(PREFIX)}", None
    if stated:
        azimuth, elevation = (parse_number(number or str(ELEVATION), source) for number in stated)
        toward = direction(azimuth, elevation, source)
    coefficients = place_light(read_photo(path, "place").codes, toward)
    note = f"the light is estimated from {path}: if you know where it comes from, give --light {PREFIX}{path}@-60,40"
    light = Light(orient(coefficients, yaw, flip), source, notes=[] if stated else [f"{note} (60 degrees left, 40 up)"])
    return light.at_order(order)


def load_any_light(text: str, order: int = 2, **options: Unpack[LightOptions]) -> Light:
    """Loads the light that `text` names: that of a place by PREFIX, else as `relight.lights.load_light`."""
    if not text.startswith(PREFIX):
        return load_light(text, order, **options)
    return read_place(text, order, options.get("yaw", 0.0), options.get("flip", False))
