"""Any light that a user can name, as a Light."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from relight.files import UserError, existing
from relight.lights.chain import GENERATORS
from relight.lights.light import Light
from relight.lights.probes import probe
from relight.lights.statistics import measure
from relight.lights.table import load as load_set
from relight.npz import read_npy
from relight.panoramas.panorama import Panorama
from relight.panoramas.project import orient, project
from relight.panoramas.read import read_panorama
from relight.sh.basis import basis
from relight.sh.conventions import CONVENTIONS, as_table, to_relight
from relight.srgb import decode

GENERATED = re.compile(r"(room|sky):(\d{1,9})(?::([-+.0-9]+))?")
KEY = re.compile(r"key:#?([0-9a-fA-F]{6})@([-+.0-9]+),([-+.0-9]+)(?:,([-+.0-9]+))?")
IN_SET = re.compile(r"(.+\.(?:npz|csv)):(\d{1,9})")
FILL = 0.2  # of a key light's strength, from everywhere
BELOW = 1.1  # times as much irradiance from below as from above is worth a word
LARGEST_FILE = 1 << 20  # bytes of a file of coefficients


def load_light(
    text: str | Path,
    order: int = 2,
    layout: str = "auto",
    yaw: float = 0.0,
    flip: bool = False,
    exposure: float = 1.0,
    convention: str | None = None,
    repair: bool = False,
    upside_down: bool = False,
) -> Light:
    """The light that `text` names, with (order + 1)^2 coefficients of radiance; not scaled to any brightness.

    kitchen.hdr, .exr, .pfm         a panorama (`layout`, see relight.panoramas.read)
    probe.npy, .txt, .csv, .json    coefficients, in `convention`, else the one the file says, else relight's; a file
                                    says it in its JSON or in its name (lights.kanamori2018.npy)
    lights.npz:12                   row 12 of a light set
    room:7, sky:3, room:7:40        a generated panorama, turned by 40 degrees
    probe:grace                     a measured light in print: grace, eucalyptus, stpeters, kitchen, galileo
    key:#ffeedd@45,30,0.2           a lamp of this sRGB colour, 45 degrees to the right of the camera, 30 degrees up,
                                    with a fill of 0.2 of its strength from everywhere

    `yaw` (degrees, +z toward +x), `flip` and `exposure` apply to all of them, and to the panorama of those that have
    one; `repair` and `upside_down` to panoramas from files. `notes` of the light say what a user should know of it.
    UserError for anything else.
    """
    text = str(text)
    if not (np.isfinite(exposure) and exposure > 0 and np.isfinite(yaw)):
        raise UserError(f"exposure={exposure}, yaw={yaw}: must be a positive number and a number of degrees")
    if convention is not None and convention not in CONVENTIONS:
        raise UserError(f"convention {convention!r}: one of {', '.join(CONVENTIONS)}")
    if match := GENERATED.fullmatch(text):
        pixels = GENERATORS[match[1]](int(match[2])) * np.float32(exposure)
        panorama = Panorama(pixels, flip=flip, yaw=yaw + number(match[3] or "0", text), source=text)
        light = Light(project(panorama, order), text, panorama)
    elif match := KEY.fullmatch(text):
        light = Light(key_light(match[1], *(number(n or str(FILL), text) for n in match.groups()[1:]), order), text)
    elif text.startswith("probe:"):
        light = Light(probe(text.removeprefix("probe:")), text)
    elif (match := IN_SET.fullmatch(text)) and not Path(text).exists():
        light = row_of_set(match[1], int(match[2]))
    elif text.startswith(("room:", "sky:", "key:")):
        raise UserError(f"{text}: a generated light is like room:7, sky:3 or key:#ffeedd@45,30")
    elif Path(text).suffix.lower() in (".npy", ".txt", ".csv", ".json"):
        light = coefficients_file(existing(text, "light"), convention)
    elif Path(text).suffix.lower() == ".npz":
        raise UserError(f"{text}: a set of lights; say which one ({text}:0)")
    else:
        panorama = read_panorama(text, layout, yaw, flip, exposure, repair, upside_down)
        coefficients = project(panorama, order)
        light = Light(coefficients, text, panorama, panorama.repairs + from_below(text, coefficients, upside_down))
    if light.panorama is None:
        light = replace(light, coefficients=orient(light.coefficients, yaw, flip) * exposure)
    return light.judged().at_order(order)


def from_below(text: str, coefficients: np.ndarray, upside_down: bool) -> list[str]:
    """A sentence for a panorama (K, 3) that is brighter from below than from above: most often it is upside down."""
    found = measure(coefficients[None])
    if found["down"][0] <= BELOW * found["up"][0]:
        return []
    told = "without --upside-down" if upside_down else "with --upside-down, if its rows run from the bottom up"
    return [f"{text}: brighter from below than from above; read it {told}"]


def number(text: str, whole: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UserError(f"{whole}: {text!r} is not a number") from None


def key_light(colour: str, azimuth: float, elevation: float, fill: float, order: int) -> np.ndarray:
    """A distant lamp (K, 3) of irradiance `colour` (sRGB, six hex digits) on a facing surface, and a fill around it.

    UserError for an elevation beyond straight up or down, a fill below 0 and numbers that are not finite.
    """
    if not -90 <= elevation <= 90:
        raise UserError(f"key:#{colour}: elevation {elevation:g} is outside of -90 (from below) to 90 (from above)")
    if not (np.isfinite(azimuth) and np.isfinite(fill) and fill >= 0):
        raise UserError(
            f"key:#{colour}: azimuth {azimuth:g}, fill {fill:g}: a number of degrees, and a share from 0 up"
        )
    linear = decode(np.array([int(colour[i : i + 2], 16) for i in (0, 2, 4)]) / 255)
    a, e = np.radians(azimuth), np.radians(elevation)
    toward = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    coefficients = basis(toward, order)[:, None] * linear
    coefficients[0] += fill * linear * np.sqrt(4 * np.pi) / np.pi  # a constant light of irradiance fill * colour
    return coefficients


def row_of_set(path: str, row: int) -> Light:
    lights = load_set(path)
    if row >= len(lights):
        raise UserError(f"{path}: has {len(lights)} lights, numbered from 0; there is no {row}")
    source = f"{lights.source[row]}:{lights.yaw[row]:g}"
    return Light(lights.coefficients[row].astype(np.float64), source)


def coefficients_file(path: Path, convention: str | None) -> Light:
    """A light from a file of coefficients; its convention from the caller, the JSON, the name, or relight's."""
    if path.stat().st_size > LARGEST_FILE:
        raise UserError(f"{path}: {path.stat().st_size >> 20} MB are too many for one light's coefficients")
    named = path.stem.split(".")[-1]
    said = named if named in CONVENTIONS else None
    try:
        if path.suffix.lower() == ".npy":
            array = read_npy(path)
        elif path.suffix.lower() == ".json":
            content = json.loads(path.read_text(encoding="utf-8"))
            array, inside = (content, None) if isinstance(content, list) else json_light(path, content)
            said = inside or said
        else:
            lines = (line.split("#")[0].replace(",", " ") for line in path.read_text(encoding="utf-8").splitlines())
            array = np.array([[float(word) for word in line.split()] for line in lines if line.strip()])
    except (ValueError, TypeError, OverflowError, EOFError, RecursionError) as error:
        raise UserError(f"{path}: not a table of coefficients ({str(error).splitlines()[0][:120]})") from error
    return Light(to_relight(as_table(array, str(path)), convention or said or "relight"), str(path))


def json_light(path: Path, content: object) -> tuple[object, str | None]:
    """Coefficients and convention from relight's JSON, or from a three.js LightProbe."""
    if isinstance(content, dict):
        if "coefficients" in content:
            said = content.get("convention")
            if said is not None and (not isinstance(said, str) or said not in CONVENTIONS):
                raise UserError(f"{path}: its convention is {said!r}; known are {', '.join(CONVENTIONS)}")
            return content["coefficients"], said
        inner = content.get("object", content)
        if isinstance(inner, dict) and "sh" in inner:
            return np.asarray(inner["sh"], np.float64) * float(inner.get("intensity", 1)), "threejs"
    raise UserError(f"{path}: JSON without coefficients; a light has 'convention' and 'coefficients'")
