"""Reads Wavefront OBJ files and their materials."""

import codecs
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.text import open_lines, spellings
from relight.meshes.mtl import JOINED, NO_PLACEMENT, Surface, read_libraries
from relight.meshes.obj_lines import Faces, Numbers
from relight.meshes.polygons import triangulate
from relight.meshes.raw import RawMesh, linear, unit_colors, without_tints

KEYS = {b"v", b"f", b"vt", b"vn", b"usemtl", b"mtllib"}  # others are seldom, and may be written in capitals
MAX_LINE = 1 << 20  # bytes; a file with a longer line is no text


def read_obj(path: Path) -> RawMesh:
    """Reads triangles with uv per corner, material per face, and vertex colors (`v x y z r g b`, sRGB).

    Raises:
        UserError: if the file is malformed, or a .mtl file, a material or a texture that faces use is missing.
    """
    points = Numbers(path, "v", least=3, most=8)
    coordinates = Numbers(path, "vt", least=1, most=2)
    faces = Faces(path)
    libraries: list[bytes] = []
    changes: list[tuple[int, bytes]] = [(0, b"")]  # (face line, material) where `usemtl` changes the material
    lines = 0
    for key, rest in _statements(path):
        if key == b"v":
            points.add(rest)
        elif key == b"f":
            faces.add(rest, points.count, coordinates.count)
            lines += 1
        elif key == b"vt":
            coordinates.add(rest)
        elif key == b"usemtl":
            changes.append((lines, rest.strip()))
        elif key == b"mtllib":
            libraries.append(rest.strip())
    vertices, uv = points.array(), coordinates.array()
    counts, corners = faces.arrays()
    position, polygon = triangulate(path, counts, corners[:, 0], vertices[:, :3])
    color, color_notes = _colors(vertices, points.widest)
    numbers: dict[bytes, int] = {}  # of the materials, in the order of their first face
    runs = [(name, end - line) for (line, name), (end, _) in pairwise([*changes, (lines, b"")]) if end > line]
    of_lines = np.repeat([numbers.setdefault(name, len(numbers)) for name, _ in runs], [length for _, length in runs])
    surfaces, material_notes = read_libraries(path, libraries, [*numbers], colored=color is not None)
    material = of_lines[polygon]
    raw = RawMesh(
        vertices=vertices[:, :3],
        faces=corners[:, 0][position],
        uv=_placed_uv(path, uv, corners[:, 1][position], material, [*numbers], surfaces),
        material=material,
        materials=[surface.material for surface in surfaces],
        color=None if color is None else color[corners[:, 0][position]],
        warnings=color_notes + material_notes,
    )
    return without_tints(raw)  # a face has a texture, colors of vertices or one of its material, never a product


def _colors(vertices: np.ndarray, widest: int) -> tuple[np.ndarray | None, list[str]]:
    """Returns the linear colors (V,3) after the coordinates, None if a vertex has none, and warnings."""
    if (columns := vertices.shape[1]) < 6:
        return None, ["some vertices have colors and others none: they are left out"] if widest >= 6 else []
    notes, first = [], 3
    if columns > 6:
        # x y z w r g b, as the standard has it, or x y z r g b a; alpha and w are mostly 1.
        fourth, seventh = vertices[:, 3], vertices[:, 6]
        has_alpha = columns == 7 and not (fourth == 1).all() and (seventh == seventh.max(initial=0)).all()
        first = 3 if has_alpha else 4
        meaning = "red, green, blue and alpha" if has_alpha else "a weight and red, green and blue"
        notes.append(f"the {columns - 3} numbers after the coordinates are taken as {meaning}")
    codes, unusual = unit_colors(vertices[:, first : first + 3], "its vertex colors")
    return linear(codes), notes + unusual


def _statements(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Yields keyword and rest of each line, (b"v", b"0 1 0"), and of comments; joins continued lines, skips empty ones.

    Names may hold #, so a comment ends other statements only.
    """
    with open_lines(path) as file:
        while line := file.readline(MAX_LINE):
            while line.endswith((b"\\\n", b"\\\r\n")) and JOINED.match(line) and len(line) < MAX_LINE:
                line = JOINED.sub(rb"\1 ", line) + file.readline(MAX_LINE)
            if len(line) >= MAX_LINE:
                raise UserError(f"{path} is not an .obj file: it has a line of over {MAX_LINE} bytes")
            key, rest = (*line.split(None, 1), b"", b"")[:2]  # empty where the line lacks them
            if key not in KEYS:
                key = key.lower().removeprefix(codecs.BOM_UTF8)  # in the middle of files that were joined
            if b"#" in line and key not in (b"usemtl", b"mtllib"):
                rest = rest.split(b"#", 1)[0]
            if rest or key == b"usemtl":
                yield key, rest


def _placed_uv(
    path: Path, uv: np.ndarray, corner: np.ndarray, material: np.ndarray, names: list[bytes], surfaces: list[Surface]
) -> np.ndarray | None:
    """Returns the texture coordinates of each face's corners, scaled and moved as its material says (-s and -o).

    `corner` (F,3) holds indices into `uv` (T,1|2), -1 for none, and `material` (F,) indices into `names` and
    `surfaces`. Returns (F,3,2) with zeros on faces without a texture, or None if all are without; raises UserError if
    textured faces have no coordinates.
    """
    has_texture = [surface.material is not None and surface.material.texture is not None for surface in surfaces]
    textured = np.array(has_texture)[material]
    if not textured.any():
        return None
    used = corner[textured]
    if used.max() >= len(uv):
        raise UserError(f"{path}: a face names texture coordinate {used.max() + 1}, but there are {len(uv)}")
    if (used < 0).any():
        first_without = int(material[textured][(used < 0).any(axis=-1)][0])
        name = spellings(names[first_without])[0]
        raise UserError(f"{path}: faces of the textured material {name!r} have no texture coordinates")
    placed = np.zeros((len(corner), 3, 2))
    placed[textured, :, : uv.shape[1]] = uv[used, :2]
    for index, surface in enumerate(surfaces):
        if surface.placement is not NO_PLACEMENT:
            faces = material == index
            placed[faces] = placed[faces] * surface.placement[:2] + surface.placement[2:]
    return placed
