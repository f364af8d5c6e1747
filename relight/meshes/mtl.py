"""Reads the materials of .obj files: .mtl libraries and their textures."""

import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.text import open_lines, spellings
from relight.meshes.find import find_file
from relight.meshes.mesh import CLAMP, REPEAT, Material
from relight.meshes.raw import linear, unit_colors
from relight.pictures.texture import read_texture

MAX_BYTES = 16 << 20  # a material has under 1 kB
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
VECTOR = rf"{NUMBER}(?:\s+{NUMBER}){{0,2}}"  # the second and third are optional
OPTION = re.compile(
    rf"(?i)-(?:clamp\s+(?P<clamp>\S+)|(?:blendu|blendv|cc|imfchan|type)\s+\S+|(?:bm|boost|texres)\s+{NUMBER}"
    rf"|mm\s+{NUMBER}\s+{NUMBER}|(?P<vector>[ost])\s+(?P<values>{VECTOR}))\s+(?=\S)"
)
# A line that a backslash joins to the next one, also in .obj files: no comment, which may end in a folder of Windows;
# after a byte over 127, the backslash is half a character of Shift-JIS, Big5 or GBK.
JOINED = re.compile(rb"(?m)^(?!\s*#)(.*(?<![\x80-\xff]))\\\r?\n")
MAPS = (b"map_kd", b"map_ka", b"map_ke")  # of the color; the first that a material has counts
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
        statements: its `mtllib` lines without that keyword; each is one name, which may hold blanks, or several names.
        names: of the materials; b"" is none.
        colored: whether the vertices have colors, so that a library that no face uses may be missing.

    Returns:
        A surface for each name, in their order, and warnings (sentences for the report).

    Raises:
        UserError: if a library or a material that is used is missing, or a library is damaged.
    """
    library: dict[bytes, Surface] = {}
    missing: list[UserError] = []
    files: list[Path] = []
    for statement in statements:
        for file in _library_files(path, statement, missing):
            for name, surface in _read_mtl(file).items():
                if name in library and file not in files:
                    surface.warnings.append(f"{file.name} defines the material {spellings(name)[0]!r} again: it counts")
                library[name] = surface
            files.append(file)
    uses_materials = any(names)
    needs_library = uses_materials and statements
    named = [_named(library, name) if needs_library else Surface(None, NO_PLACEMENT, []) for name in names]
    undefined = [name for name, surface in zip(names, named) if surface is None]
    if missing and (undefined or not (uses_materials or colored)):
        raise missing[0]
    if undefined:
        listed = ", ".join(spellings(statement)[0] for statement in statements)
        raise UserError(f"{path} uses the material {spellings(undefined[0])[0]!r}, which {listed} does not define")
    notes = [f"{error}; no face needs it" for error in missing]
    if uses_materials and not statements:
        notes.append("the file uses materials but names no .mtl file: they are left out")
    surfaces = [surface for surface in named if surface is not None]
    return surfaces, notes + [warning for surface in surfaces for warning in surface.warnings]


def _library_files(path: Path, statement: bytes, missing: list[UserError]) -> list[Path]:
    """Finds the libraries of a `mtllib` line: of its whole text as one name, else of each of its words.

    `statement` is the line without its keyword; names may be in quotes. `missing` gets an error for each file that is
    not found.
    """
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
    """Returns the surface of a name: of the same bytes, else without quotes or a comment, else of the same text.

    The empty name, of faces before any `usemtl`, is a surface without color. None if the library has no such name.
    """
    if not name:
        return Surface(None, NO_PLACEMENT, [])
    for written in (name, name.strip(b'"'), *_without_comment(name)):
        if written in library:
            return library[written]
    alike = [known for known in library if _texts(known) & _texts(name)]
    return library[alike[0]] if len(alike) == 1 else None


def _texts(name: bytes) -> set[str]:
    """Returns what the bytes of a name may say, in the code page of whoever wrote it; accents are composed."""
    return {unicodedata.normalize("NFC", text) for text in spellings(name)}


def _read_mtl(path: Path) -> dict[bytes, Surface]:
    """Reads a .mtl file and its textures.

    A texture is not multiplied by Kd, as exporters write .8 or 0 beside it as often as 1. It is that of map_Kd, or else
    of map_Ka or map_Ke. Without a texture, the color is Kd, taken as sRGB as most exporters write it.
    """
    if path.stat().st_size > MAX_BYTES:
        raise UserError(f"{path} is too large for a material library")
    entries: dict[bytes, dict[bytes, bytes]] = {}  # the statements of each material, by key
    twice: set[bytes] = set()
    textures: dict[Path, np.ndarray] = {}  # that were read: materials may share them
    statements: dict[bytes, bytes] = {}
    with open_lines(path) as opened:
        lines = JOINED.sub(rb"\1 ", opened.read()).splitlines()
    for line in lines:
        key, rest = (*line.split(None, 1), b"", b"")[:2]  # empty where the line lacks them
        statements[key.lower()] = rest.strip()
        if key.lower() == b"newmtl":
            twice |= {rest.strip()} & entries.keys()
            entries[rest.strip()] = statements = {}
    library = {name: _surface(path, statements, textures) for name, statements in entries.items()}
    for name in twice:
        text = spellings(name)[0]
        library[name].warnings.insert(0, f"{path.name} defines the material {text!r} twice: the last one counts")
    return library


def _surface(path: Path, statements: dict[bytes, bytes], textures: dict[Path, np.ndarray]) -> Surface:
    """Returns the surface of a material's statements, by key; `textures` holds and gets those of the library."""
    key = next((key for key in MAPS if statements.get(key)), b"map_kd" if b"map_kd" in statements else None)
    if key is None:
        color, notes = _parse_color(path, statements[b"kd"]) if b"kd" in statements else (None, [])
        return Surface(None if color is None else Material(color), NO_PLACEMENT, notes)
    written, placement, clamp = _parse_map(statements[key])
    if b"<udim>" in written.lower():
        raise UserError(f"{path}: the texture {spellings(written)[0]} is of several tiles: bake them into one picture")
    if (file := find_file(path, written, *_without_comment(written))) not in textures:
        textures[file] = read_texture(file, f"{path}: texture {spellings(written)[0]}")
    material = Material(texture=textures[file], wrap=(CLAMP, CLAMP) if clamp else (REPEAT, REPEAT))
    notes = [] if key == b"map_kd" else [f"its only texture {file.name} is of {key.decode()}: taken as the color"]
    return Surface(material, placement, notes)


def _parse_color(path: Path, text: bytes) -> tuple[np.ndarray, list[str]]:
    """Returns the linear color (3,) float32 of a Kd statement of one or three numbers, and warnings (sentences)."""
    try:
        values = np.array([float(word) for word in text.split()[:3]])
        if len(values) not in (1, 3):
            raise ValueError
    except ValueError:
        raise UserError(f"{path}: the color `Kd {text[:60].decode('latin-1')}` is not three numbers") from None
    codes, notes = unit_colors(np.broadcast_to(values, 3), f"{path.name}: Kd")
    return linear(codes), notes


def _parse_map(text: bytes) -> tuple[bytes, np.ndarray, bool]:
    """Parses a map statement: the file, whose name may hold blanks, scale and offset of uv, whether it is clamped."""
    placement, clamp, rest = NO_PLACEMENT.copy(), False, text.decode("latin-1")
    while match := OPTION.match(rest):
        values = [float(value) for value in (match["values"] or "").split()]
        vector = (match["vector"] or "").lower()
        if vector == "s":
            placement[:2] = [*values, 1.0][:2]  # a second number may be missing
        elif vector == "o":
            placement[2:] = [*values, 0.0][:2]
        if match["clamp"]:
            clamp = match["clamp"].lower() == "on"
        rest = rest[match.end() :]
    return rest.strip().strip('"').encode("latin-1"), placement, clamp
