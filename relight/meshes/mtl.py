"""Reads the materials of .obj files: .mtl libraries and their textures."""

import os
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from relight.files import UserError
from relight.meshes.mesh import Material
from relight.meshes.raw import linear, read_texture

MAX_BYTES = 16 << 20  # a material has under 1 kB
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
VECTOR = rf"{NUMBER}(?:\s+{NUMBER}){{0,2}}"  # the second and third are optional
OPTION = re.compile(
    rf"-(?:(?P<key>blendu|blendv|cc|clamp|imfchan|type)\s+\S+|(?P<one>bm|boost|texres)\s+{NUMBER}"
    rf"|(?P<pair>mm)\s+{NUMBER}\s+{NUMBER}|(?P<vector>[ost])\s+(?P<values>{VECTOR}))\s+(?=\S)"
)


@dataclass
class Library:
    """Materials of a library.

    Attributes:
        materials: by name.
        placement: (4,) by name, scale u v and offset u v of texture coordinates, by the options -s and -o.
    """

    materials: dict[str, Material]
    placement: dict[str, np.ndarray]


def read_mtl(path: Path) -> Library:
    """Reads a .mtl file and its textures.

    A texture is not multiplied by Kd, as exporters write .8 or 0 beside it as often as 1. Without a texture, the colour
    is Kd, taken as sRGB as most exporters write it.

    Raises:
        UserError: if the file is too large, or a texture is missing, outside the folder or damaged.
    """
    if path.stat().st_size > MAX_BYTES:
        raise UserError(f"{path} is too large for a material library")
    materials: dict[str, Material] = {}
    placement: dict[str, np.ndarray] = {}
    pictures: dict[Path, np.ndarray] = {}
    name = None
    for line in path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ").splitlines():
        key, _, rest = line.strip().partition(" ") if " " in line.strip() else line.strip().partition("\t")
        key, rest = key.lower(), rest.strip()
        if key == "newmtl":
            name = rest
            materials[name] = Material()
        elif name is None:
            continue
        elif key == "kd" and materials[name].texture is None:
            materials[name].color = _color(path, rest)
        elif key == "map_kd":
            file, placement[name] = _map(rest)
            found = find_file(path, file)
            if found not in pictures:
                pictures[found] = read_texture(found, f"{path}: texture {file}")
            materials[name] = Material(texture=pictures[found])
    return Library(materials, placement)


def _color(path: Path, text: str) -> np.ndarray:
    """Parses the linear colour (3,) of a Kd statement."""
    try:
        values = np.array([float(word) for word in text.split()[:3]])
    except ValueError:
        raise UserError(f"{path}: the colour `Kd {text[:60]}` is not three numbers") from None
    return linear(np.broadcast_to(values, 3) if len(values) in (1, 3) else np.ones(3))


def _map(text: str) -> tuple[str, np.ndarray]:
    """Parses the file and the placement (4,) of a map statement; names may hold spaces."""
    placement = np.array([1.0, 1.0, 0.0, 0.0])
    while match := OPTION.match(text):
        if match["vector"] in ("s", "o"):
            values = [float(value) for value in match["values"].split()]
            default = 1.0 if match["vector"] == "s" else 0.0
            first = 0 if match["vector"] == "s" else 2
            placement[first : first + 2] = (values + [default])[:2]
        text = text[match.end() :]
    return text.strip().strip('"'), placement


def find_file(beside: Path, name: str) -> Path:
    """Finds a file that another one names, in the same folder or a subfolder; never outside of it.

    The path as written is tried first, then the name alone in the folder, then in its subfolders. So backslashes, other
    capitals and folders of another computer do no harm.

    Args:
        beside: the .obj, .mtl, .ply or .gltf file that names it.
        name: as written there.

    Raises:
        UserError: if there is no such file, if several are found in subfolders, or if it is outside the folder.
    """
    folder = beside.parent.resolve()
    wanted = PurePosixPath(name.replace("\\", "/"))
    if not wanted.name:
        raise UserError(f"{beside} names no file where it should name one")
    inside = not wanted.is_absolute() and ".." not in wanted.parts and ":" not in wanted.parts[0]
    found = (_find_path(folder, wanted.parts) if inside else None) or _find_path(folder, wanted.parts[-1:])
    if found is None:
        matches = {
            Path(root, file)
            for root, folders, files in os.walk(folder)
            for file in files
            if file.lower() == wanted.name.lower()
        }
        if len(matches) > 1:
            raise UserError(f"{beside} names {name}, and {len(matches)} files in the subfolders are called so")
        found = next(iter(matches), None)
    if found is None:
        where = "it lies outside the folder" if not inside else "there is no such file in the folder"
        raise UserError(f"{beside} names {name}, but {where}; put it beside {beside.name}")
    try:
        real = found.resolve(strict=True)
    except (OSError, RuntimeError):
        raise UserError(f"{beside} names {name}, which is a link that leads nowhere") from None
    if not real.is_relative_to(folder) or not real.is_file():
        raise UserError(
            f"{beside} names {name}, which leads out of the folder or is no file; put it beside {beside.name}"
        )
    return real


def _find_path(folder: Path, parts: tuple[str, ...]) -> Path | None:
    """Returns the path `parts` in `folder`, with the given capitals or else with any; None if there is none."""
    path = folder
    for part in parts:
        if part in ("", "."):
            continue
        if not os.path.lexists(path / part):
            names = sorted(os.listdir(path)) if path.is_dir() else []
            alike = next((name for name in names if name.lower() == part.lower()), None)
            if alike is None:
                return None
            part = alike
        path = path / part
    return path
