"""Loads lights by name: panoramas, files of coefficients, generated, printed and key lights."""

import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches
from numbers import Integral
from pathlib import Path

import numpy as np
from PIL import ImageColor

from relight import extensions
from relight.core.errors import UserError
from relight.core.files import PHOTO_SUFFIXES, existing_file
from relight.core.npz import read_npy
from relight.core.numbers import finite
from relight.core.srgb import decode
from relight.core.text import read_text
from relight.lights.light import Light, direction, parts_of, total
from relight.lights.place import read_place
from relight.lights.statistics import is_lit_from_below, measure
from relight.lights.table import read_light_set
from relight.panoramas import Panorama, orient, polyhaven, project, read_panorama
from relight.panoramas.lamps import generate_lamps
from relight.panoramas.rooms import generate_room
from relight.panoramas.skies import generate_sky
from relight.sh import CONVENTIONS, basis, to_relight
from relight.sh.conventions import as_table

# Kinds of generated panoramas, after which their lights are named, such as room:7: seed -> (H,W,3) radiance.
GENERATED = {"room": generate_room, "sky": generate_sky, "lamps": generate_lamps}
SEED = re.compile(r"(\d{1,9})(?::([-+.0-9]+))?")
KIND = re.compile(r"([a-z]{2,}):")  # Windows has drives of one letter
HEXADECIMAL = re.compile(r"[0-9a-fA-F]{6}")  # the only color that needs no #
IN_SET = re.compile(r"(.+\.(?:npz|csv)):(\d{1,9})", re.I)
EVEN = "even"
ELEVATION = 30  # default degrees of a key light above the horizon
FILL = 0.2  # default irradiance of the fill, relative to the key light's
MAX_FILL = 1e6
MAX_BYTES = 1 << 20  # of a file of coefficients


def load_light(
    text: str | Path,
    order: int = 2,
    layout: str = "auto",
    yaw: float = 0.0,
    flip: bool = False,
    convention: str | None = None,
    repair: bool = False,
) -> Light:
    """Loads the light that `text` names. Its brightness is not normalised.

    kitchen.hdr, .exr               a panorama
    hall, park, sunset:90 ...       a panorama of Poly Haven, after `relight light setup` (relight.panoramas.polyhaven)
    probe.npy, .txt, .csv, .json    coefficients
    lights.npz:12                   row 12 of a light set
    room:7, sky:3, lamps:5, room:7:40  a generated panorama, the last one rotated by 40 degrees
    even                            light without a direction, of irradiance 1
    key:#ffeedd@45,30,0.2           a distant lamp of this sRGB color, 45 degrees to the right of the camera and 30
                                    degrees up, with a constant fill of 0.2 times its irradiance (both by default)
    place:street.jpg                an estimate from a photograph of a place (relight.lights.place)
    mine:text                       the light that the extension `mine` returns for the text
    room:7 + key:#ffeedd@45,30      the sum of lights

    Args:
        text: as above.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.
        layout: layout of a panorama's file (`read_panorama`).
        yaw: degrees of rotation about the vertical, from +z toward +x.
        flip: mirrors left and right, before the rotation.
        convention: of a file of coefficients; by default the one in its JSON or its name (lights.kanamori2018.npy),
            else relight's.
        repair: whether non-finite pixels of a panorama's file are replaced, which otherwise are an error, and a sun
            that has lost its red is rebuilt.

    Returns:
        The light with (order + 1)^2 coefficients; its `notes` are for the user.

    Raises:
        UserError: if `text` names no light, the light is black, or an argument is out of range or has no effect.

    >>> load_light("key:#ffffff@90,0,0", order=1).coefficients[:, 0].round(2).tolist()  # from +x
    [0.28, 0.0, 0.0, 0.49]
    """
    text = str(text)
    if not (isinstance(order, Integral) and order >= 0):
        raise UserError(f"order={order!r}: it must be a whole number, at least 0")
    yaw = finite("yaw", yaw)
    if len(parts := parts_of(text)) > 1:
        return total([load_light(part, order, layout, yaw, flip, convention, repair) for part in parts], text)
    kind = None  # of the file, by which options have an effect
    name, colon, rest = text.partition(":")
    if colon and name in GENERATED:
        if not (match := SEED.fullmatch(rest)):
            raise UserError(f"{text} is malformed: a generated light is {name}:7; a sum has blanks around its plus")
        panorama = Panorama(GENERATED[name](int(match[1])))
        light = Light(project(panorama, order), text, panorama)
        yaw += finite(f"{text}: the turn", match[2] or 0)
    elif colon and name in NAMED:
        light = NAMED[name](rest, order)
    elif text == EVEN:
        light = Light(np.eye((order + 1) ** 2, 1) * np.full(3, np.sqrt(4 * np.pi) / np.pi), text)
    elif (match := IN_SET.fullmatch(text)) and not os.path.exists(text):
        lights, row = read_light_set(match[1]), int(match[2])
        if row >= len(lights):
            raise UserError(f"{match[1]} has {len(lights)} lights, numbered from 0: there is no light {row}")
        light = Light(lights.coefficients[row].astype(np.float64), f"{lights.source[row]}:{lights.yaw[row]:g}")
    elif colon and name in extensions.names():
        answer = extensions.extension(name, "light")(rest, order)
        light = answer if isinstance(answer, Light) else Light(as_table(answer, text), text)
    elif KIND.match(text) and name not in polyhaven.NAMES and not os.path.exists(text):
        kinds = ", ".join([*GENERATED, *NAMED, *extensions.names()])
        raise UserError(f"{text}: there is neither such a file nor a kind of light {name!r}; kinds are {kinds}")
    elif Path(text).suffix.lower() in (".npy", ".txt", ".csv", ".json"):
        kind = "coefficients"
        light = _read_coefficients(existing_file(text, "light"), convention)
    elif Path(text).suffix.lower() == ".npz":
        raise UserError(f"{text} is a set of lights: name one of them, such as {text}:0")
    elif Path(text).suffix.lower() in PHOTO_SUFFIXES:
        raise UserError(f"{text} is a photo, and a panorama is .hdr or .exr: place:{text} estimates its light")
    else:
        kind = "a panorama"
        path, turn = _find_panorama(text)
        yaw += turn
        panorama = read_panorama(path, layout, repair or path != text)
        coefficients = project(panorama, order)
        notes = panorama.repairs if path == text else []  # docs/lab/lights.md tells those of Poly Haven's
        if is_lit_from_below(measure(coefficients[None]))[0]:
            notes = [*notes, f"{text}: brighter from below than from above; are its rows upside down?"]
        light = Light(coefficients, text, panorama, notes)
    for name, is_given in {"layout": layout != "auto", "repair": repair, "convention": convention}.items():
        needed = "coefficients" if name == "convention" else "a panorama"
        if is_given and kind != needed:
            raise UserError(f"{text}: {name} has an effect on a file of {needed} only")
    if yaw or flip:
        if (seen := light.panorama) is not None:
            own_yaw = -seen.yaw if flip else seen.yaw
            seen = replace(seen, flip=seen.flip != flip, yaw=own_yaw + yaw)
        light = replace(light, coefficients=orient(light.coefficients, yaw, flip), panorama=seen)
    return light.checked().at_order(order)


def _find_panorama(text: str) -> tuple[str | Path, float]:
    """Returns the file of a panorama, the user's or else one by Poly Haven, and degrees by which `text` turns it."""
    name, _, degrees = text.partition(":")
    if os.path.isfile(text) or (Path(text).suffix and name not in polyhaven.NAMES):
        return text, 0.0
    if name not in polyhaven.NAMES:
        lamp = "a lamp, such as key:white@-60,30 (60 degrees to the left, 30 up)"
        near = get_close_matches(text, polyhaven.NAMES, 1) or ["hall"]
        raise UserError(f"{text} is neither a file nor a light: give {lamp}, room:7, sky:3, even, or {near[0]}")
    return polyhaven.panorama_file(name), finite(f"{text}: the turn", degrees or 0)


def _read_key(text: str, order: int) -> Light:
    """Returns the key light of a color, azimuth, elevation and fill, such as #ffeedd@45,30,0.2; the last may lack."""
    color, _, numbers = text.partition("@")
    try:
        red, green, blue = bytes(ImageColor.getrgb(f"#{color}" if HEXADECIMAL.fullmatch(color) else color))
    except ValueError:  # also of a color with alpha, as #abcd is, or beyond 255, as hsl(30,501%,40%)
        raise UserError(f"key:{text}: {color!r} is no color: give #ffeedd, or a name such as red") from None
    parts = numbers.split(",")
    if len(parts) > 3 or not numbers:
        raise UserError(f"key:{text}: after the @ come azimuth, elevation and fill, such as @45,30,{FILL}")
    usual = ("", str(ELEVATION), str(FILL))
    azimuth, elevation, fill = (*parts, *usual[len(parts) :])
    return Light(key_light(bytes((red, green, blue)).hex(), azimuth, elevation, fill, order), f"key:{text}")


def key_light(color: str, azimuth: float | str, elevation: float | str, fill: float | str, order: int) -> np.ndarray:
    """Returns the light (K,3) of a distant lamp and a constant fill.

    Args:
        color: irradiance of the lamp on a surface that faces it, six hexadecimal digits of sRGB.
        azimuth: degrees from the camera toward +x, -360 to 360.
        elevation: degrees above the horizon, -90 to 90.
        fill: irradiance of the fill over that of the lamp, 0 to MAX_FILL.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.

    Raises:
        UserError: if a number is out of range.
    """
    toward = direction(azimuth, elevation, f"key:#{color}")
    linear = decode(np.array([int(color[i : i + 2], 16) for i in (0, 2, 4)]) / 255)
    coefficients = basis(toward, order)[:, None] * linear
    even = finite(f"key:#{color}: fill", fill, 0, MAX_FILL) * linear
    coefficients[0] += even * np.sqrt(4 * np.pi) / np.pi  # a constant light of irradiance fill * color
    return coefficients


# Other kinds: what follows the colon, and the order, to the light.
NAMED: dict[str, Callable[[str, int], Light]] = {"key": _read_key, "place": read_place}


def _read_coefficients(path: Path, convention: str | None) -> Light:
    """Reads coefficients in a convention, or in that of their JSON, else of the file's name, else relight's."""
    if path.stat().st_size > MAX_BYTES:
        size = path.stat().st_size >> 20
        raise UserError(f"{path} has {size} MB; the coefficients of a light take at most {MAX_BYTES >> 20} MB")
    suffix = path.stem.split(".")[-1].lower()  # as in lights.kanamori2018.npy
    named_convention = suffix if suffix in CONVENTIONS else None
    try:
        if path.suffix.lower() == ".npy":
            array: object = read_npy(path)
        elif path.suffix.lower() == ".json":
            content = json.loads(read_text(path))
            array, declared_convention = (content, None) if isinstance(content, list) else _parse_json(path, content)
            named_convention = declared_convention or named_convention
        else:
            array = _parse_rows(path, read_text(path))
    except (ValueError, TypeError, OverflowError, EOFError, RecursionError) as error:
        raise UserError(f"{path} is not a table of coefficients ({str(error).splitlines()[0][:120]})") from error
    notes = []
    if convention and named_convention not in (None, convention):
        notes.append(f"{path} says that its convention is {named_convention}; it is read as {convention}")
    coefficients = to_relight(as_table(array, str(path)), convention or named_convention or "relight")
    return Light(coefficients, str(path), notes=notes)


def _parse_rows(path: Path, text: str) -> np.ndarray:
    """Parses rows of numbers between blanks, commas or semicolons; beside semicolons and tabs a comma is a point."""
    if text.startswith("split"):  # the first column of a light set
        raise UserError(f"{path} is a set of lights: name one of them, such as {path}:0")
    point = "." if re.search(r"[;\t]", text) and not re.search(r"\d\.\d", text) else " "
    lines = (re.sub(r'[;"]', " ", line.split("#")[0].replace(",", point)) for line in text.splitlines())
    return np.array([[float(word) for word in line.split()] for line in lines if line.strip()])


def _parse_json(path: Path, content: object) -> tuple[object, str | None]:
    """Returns coefficients and convention of the JSON of relight or of a three.js LightProbe."""
    if isinstance(content, dict):
        if "coefficients" in content:
            convention = content.get("convention")
            if convention is not None and (not isinstance(convention, str) or convention not in CONVENTIONS):
                raise UserError(f"{path}: its convention is {convention!r}; known are {', '.join(CONVENTIONS)}")
            return content["coefficients"], convention
        inner = content.get("object", content)
        if isinstance(inner, dict) and "sh" in inner:
            return np.asarray(inner["sh"], np.float64) * float(inner.get("intensity", 1)), "threejs"
    raise UserError(f"{path}: JSON without coefficients; a light has 'convention' and 'coefficients'")
