"""Reads the materials of .obj files: .mtl libraries and their textures."""

import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.errors import UserError
from relight.meshes.find import find_file
from relight.meshes.mesh import CLAMP, REPEAT, Material
from relight.meshes.raw import linear, read_texture, unit_colors
from relight.text import open_lines, spellings

MAX_BYTES = 16 << 20  # a material has under 1 kB
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
VECTOR = rf"{NUMBER}(?:\s+{NUMBER}){{0,2}}"  # the second and third are optional
OPTION = re.compile(
    rf"-(?:clamp\s+(?P<clamp>\S+)|(?:blendu|blendv|cc|imfchan|type)\s+\S+|(?:bm|boost|texres)\s+{NUMBER}"
    rf"|mm\s+{NUMBER}\s+{NUMBER}|(?P<vector>[ost])\s+(?P<values>{VECTOR}))\s+(?=\S)"
)
NO_PLACEMENT = np.array([1.0, 1.0, 0.0, 0.0])


@dataclass
class Surface:
    """An entry of a library.

    Attributes:
        material: None while the library says nothing of its color.
        placement: (4,) scale u v and offset u v of texture coordinates, by the options -s and -o.
        warnings: sentences for the report.
    """

    material: Material | None
    placement: np.ndarray
    warnings: list[str]


def read_libraries(
    path: Path, statements: list[bytes], names: list[bytes], colored: bool
) -> tuple[list[Surface], list[str]]:
    """Reads the materials that an .obj file uses.

    Args:
        path: of the .obj file.
        statements: the rests of its `mtllib` lines, each one name, which may hold blanks, or several.
        names: of the materials; b"" is none.
        colored: whether the vertices have colors, so that a library that no face uses may be missing.

    Returns:
        A surface for each name, and warnings.

    Raises:
        UserError: if a library or a material that is used is missing, or a library is damaged.
    """
    library: dict[bytes, Surface] = {}
    missing: list[UserError] = []
    files: list[Path] = []
    for statement in statements:
        for file in _library_files(path, statement, missing):
            for name, surface in read_mtl(file).items():
                if name in library and file not in files:
                    surface.warnings.append(f"{file.name} defines the material {spellings(name)[0]!r} again: it counts")
                library[name] = surface
            files.append(file)
    unused = not any(names)
    found = {name: Surface(None, NO_PLACEMENT, []) if unused or not statements else _named(library, name)
             for name in names}  # fmt: skip
    lost = [name for name, surface in found.items() if surface is None]
    if missing and (lost or (unused and not colored)):
        raise missing[0]
    if lost:
        listed = ", ".join(spellings(statement)[0] for statement in statements)
        raise UserError(f"{path} uses the material {spellings(lost[0])[0]!r}, which {listed} does not define")
    notes = [f"{error}; no face needs it" for error in missing]
    if not unused and not statements:
        notes.append("the file uses materials but names no .mtl file: they are left out")
    surfaces = [surface for surface in found.values() if surface is not None]
    return surfaces, notes + [warning for surface in surfaces for warning in surface.warnings]


def _library_files(path: Path, statement: bytes, missing: list[UserError]) -> list[Path]:
    """Returns the files of a `mtllib` line; what is not found is added to `missing`."""
    whole = statement.strip().strip(b'"')
    try:
        return [find_file(path, whole, *_without_comment(whole))]
    except UserError as error:
        words = [(quoted or bare) for quoted, bare in re.findall(rb'"([^"]+)"|(\S+)', statement)]
        if len(words) == 1:
            missing.append(error)
            return []
    files = []
    for word in words:
        try:
            files.append(find_file(path, word))
        except UserError as error:
            missing.append(error)
    return files


def _without_comment(name: bytes) -> list[bytes]:
    """Returns a name without what may be a comment at its end, if there is such: names may hold # as well."""
    return [name.split(b" #")[0].rstrip()] if b" #" in name else []


def _named(library: dict[bytes, Surface], name: bytes) -> Surface | None:
    """Returns the surface of a name: of the same bytes, else without quotes or a comment, else of the same text."""
    if not name:
        return Surface(None, NO_PLACEMENT, [])
    for written in (name, name.strip(b'"'), *_without_comment(name)):
        if written in library:
            return library[written]
    alike = [known for known in library if _texts(known) & _texts(name)]
    return library[alike[0]] if len(alike) == 1 else None


def _texts(name: bytes) -> set[str]:
    return {unicodedata.normalize("NFC", text) for text in spellings(name)}


def read_mtl(path: Path) -> dict[bytes, Surface]:
    """Reads a .mtl file and its textures.

    A texture is not multiplied by Kd, as exporters write .8 or 0 beside it as often as 1. Without a texture, the color
    is Kd, taken as sRGB as most exporters write it.

    Raises:
        UserError: if the file is too large, or a texture is missing, outside the folder or damaged.
    """
    if path.stat().st_size > MAX_BYTES:
        raise UserError(f"{path} is too large for a material library")
    library: dict[bytes, Surface] = {}
    pictures: dict[Path, np.ndarray] = {}
    surface = None
    with open_lines(path) as file:
        lines = join_lines(file.read()).splitlines()
    for line in lines:
        key, rest = (*line.split(None, 1), b"", b"")[:2]
        key, rest = key.lower(), rest.strip()
        if key == b"newmtl":
            twice = f"{path.name} defines the material {spellings(rest)[0]!r} twice: the last one counts"
            surface = library[rest] = Surface(None, NO_PLACEMENT, [twice] if rest in library else [])
        elif surface is None:
            continue
        elif key == b"kd" and (surface.material is None or surface.material.texture is None):
            color, notes = _color(path, rest)
            surface.material, surface.warnings = Material(color), surface.warnings + notes
        elif key == b"map_kd":
            written, surface.placement, clamp = _map(rest)
            found = find_file(path, written, *_without_comment(written))
            if found not in pictures:
                pictures[found] = read_texture(found, f"{path}: texture {spellings(written)[0]}")
            surface.material = Material(texture=pictures[found], wrap=(CLAMP, CLAMP) if clamp else (REPEAT, REPEAT))
    return library


def join_lines(text: bytes) -> bytes:
    """Joins lines that end in a backslash, but for comments.

    After a byte over 127, it is half a character of Shift-JIS, Big5 or GBK.
    """
    return re.sub(rb"(?m)^(?!\s*#)(.*(?<![\x80-\xff]))\\\r?\n", rb"\1 ", text)


def _color(path: Path, text: bytes) -> tuple[np.ndarray, list[str]]:
    """Parses the linear color (3,) of a Kd statement; also returns warnings."""
    try:
        values = np.array([float(word) for word in text.split()[:3]])
        if len(values) not in (1, 3):
            raise ValueError
    except ValueError:
        said = text[:60].decode("latin-1")
        raise UserError(f"{path}: the color `Kd {said}` is not three numbers") from None
    codes, note = unit_colors(np.broadcast_to(values, 3), f"{path.name}: Kd")
    return linear(codes), note


def _map(text: bytes) -> tuple[bytes, np.ndarray, bool]:
    """Parses file, placement (4,) and clamping of a map statement; names may hold blanks."""
    placement, clamp, rest = NO_PLACEMENT.copy(), False, text.decode("latin-1")
    while match := OPTION.match(rest):
        if match["vector"] in ("s", "o"):
            values = [float(value) for value in match["values"].split()]
            first = 0 if match["vector"] == "s" else 2
            placement[first : first + 2] = [*values, 1.0 if match["vector"] == "s" else 0.0][:2]
        clamp = match["clamp"] == "on" if match["clamp"] else clamp
        rest = rest[match.end() :]
    return rest.strip().strip('"').encode("latin-1"), placement, clamp
