"""Lights of places by name: an ordinary photograph without a person, and where its light comes from if that is known.

place:street.jpg            the light of the place in the photograph (relight.lights.place)
place:street.jpg@-60,40     most of it comes from 60 degrees to the left of the camera, 40 up; without the 40, 45 up
"""

import re
from pathlib import Path

from relight.errors import UserError
from relight.lights import Light
from relight.lights.light import direction, parts_of
from relight.lights.load import parse_number
from relight.lights.place import place_light
from relight.photos.person import AUTO
from relight.photos.read import is_picture, read_photo

PREFIX = "place:"
STATED = re.compile(r"(.+)@([-+.0-9]+)(?:,([-+.0-9]+))?")
ELEVATION = 45  # degrees, where none is stated; the median of 18 real places is 51


def is_of_person(light: str) -> bool:
    """Returns whether the name of a light is that of a photo of somebody, whose light it is."""
    return is_picture(light) and not light.startswith(PREFIX) and len(parts_of(light)) == 1


def default_light(background: str) -> str:
    """Returns the light that `auto` means: that of the place in the background if this is a picture, else AUTO."""
    return f"{PREFIX}{background}" if is_picture(background) else AUTO


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
    source, toward = f"{PREFIX}{text}", None
    path, stated = split_place(text)
    if not is_picture(path):
        raise UserError(f"{source}: {path} is no photograph of a place: give a JPEG, PNG, WebP or TIFF")
    if stated:
        azimuth, elevation = (parse_number(number or str(ELEVATION), source) for number in stated)
        toward = direction(azimuth, elevation, source)
    note = f"the light is estimated from {path}: if you know where it comes from, give --light {PREFIX}{path}@-60,40"
    notes = [] if stated else [f"{note} (60 degrees left, 40 up)"]
    return Light(place_light(read_photo(path, "place").codes, toward), source, notes=notes).at_order(order)
