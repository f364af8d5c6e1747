"""Reads Wavefront OBJ files and their materials."""

import codecs
import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from relight.errors import UserError
from relight.meshes.mtl import NO_PLACEMENT, Surface, read_libraries
from relight.meshes.polygons import triangulate
from relight.meshes.raw import RawMesh, linear, unit_colors, without_tints
from relight.text import open_lines, spellings

CHUNK = 1 << 17  # lines that are parsed at a time, so that 5 million faces never exist as text objects
CONTINUED = b"\\\n", b"\\\r\n"  # after a byte over 127 the backslash is half a character
KEYS = {b"v", b"f", b"vt", b"vn", b"usemtl", b"mtllib"}  # others are seldom, and may be written in capitals
MAX_LINE = 1 << 20  # bytes; a file with a longer line is no text


class Numbers:
    """Collects lines of numbers and parses them in chunks, to rows of `least` to `most` columns.

    Attributes:
        count: number of the lines.
        widest: columns of the longest line.
    """

    def __init__(self, path: Path, what: str, least: int, most: int):
        self.path, self.what, self.least, self.most = path, what, least, most
        self.lines: list[bytes] = []
        self.rows: list[np.ndarray] = []
        self.count = self.widest = 0

    def add(self, line: bytes) -> None:
        """Adds a line without its keyword."""
        self.lines.append(line)
        self.count += 1
        if len(self.lines) == CHUNK:
            self._flush()

    def _flush(self) -> None:
        if not self.lines:
            return
        width = len(self.lines[0].split())
        self.widest = max(self.widest, width)
        values = parse(self.path, b" ".join(self.lines), np.float64)
        if values.size != width * len(self.lines):  # some lines are longer than others
            widths = [len(line.split()) for line in self.lines]
            width, self.widest = min(widths), max(self.widest, *widths)
            values = parse(self.path, b" ".join(b" ".join(line.split()[:width]) for line in self.lines), np.float64)
        if width < self.least:
            raise UserError(f"{self.path}: a `{self.what}` line has {width} numbers; {self.least} are needed")
        self.rows.append(values.reshape(-1, width)[:, : self.most])
        self.lines = []

    def array(self) -> np.ndarray:
        """Returns all rows, with the number of columns that the shortest has."""
        self._flush()
        width = min((rows.shape[1] for rows in self.rows), default=self.least)
        return np.concatenate([rows[:, :width] for rows in self.rows]) if self.rows else np.zeros((0, width))


class Faces:
    """Collects lines of faces and parses them in chunks, to indices of vertices and texture coordinates."""

    def __init__(self, path: Path):
        self.path = path
        self.lines: list[bytes] = []
        self.above: list[tuple[int, int]] = []  # vertices and texture coordinates above each line, for negative indices
        self.counts: list[np.ndarray] = []
        self.corners: list[np.ndarray] = []

    def add(self, line: bytes, vertices: int, coordinates: int) -> None:
        """Adds a line without its keyword, and the numbers of vertices and texture coordinates above it."""
        self.lines.append(line)
        self.above.append((vertices, coordinates))
        if len(self.lines) == CHUNK:
            self._flush()

    def _flush(self) -> None:
        if not self.lines:
            return
        words = [line.split() for line in self.lines]
        counts = np.array([len(line) for line in words])
        flat = [word for line in words for word in line]
        corners = self._numbers(flat)
        if (corners[:, 0] == 0).any():
            raise UserError(f"{self.path}: a face names vertex 0; .obj files count from 1")
        if (corners < 0).any():
            above = np.repeat(np.array(self.above), counts, axis=0)
            corners = np.where(corners < 0, np.maximum(above + corners, -1) + 1, corners)
            if (corners[:, 0] < 1).any():
                raise UserError(f"{self.path}: a face names a vertex before the first one")
        self.counts.append(counts)
        self.corners.append(corners - 1)
        self.lines, self.above = [], []

    def _numbers(self, words: list[bytes]) -> np.ndarray:
        """Parses words `v`, `v/t`, `v//n` or `v/t/n` to (N,2) v and t, 0 for none; fast if all have one form."""
        form = words[0].count(b"/")
        text = b" ".join(words)
        slashes = text.count(b"/")
        if slashes == 0:
            vertex = parse(self.path, text, np.int64)
            return np.stack([vertex, np.zeros_like(vertex)], axis=-1)
        alike = slashes == form * len(words) and all(word.count(b"/") == form for word in words)
        if alike and form == 2 and text.count(b"//") == len(words) and b"// " not in text + b" ":
            vertex = self._table(text.replace(b"//", b" "), len(words), 2)[:, 0]
            return np.stack([vertex, np.zeros_like(vertex)], axis=-1)
        if alike and b"//" not in text and b"/ " not in text and not text.endswith(b"/"):
            return self._table(text.replace(b"/", b" "), len(words), form + 1)[:, :2]
        pairs = [(word.split(b"/") + [b""])[:2] for word in words]
        return self._table(b" ".join(b"%s %s" % (v, t or b"0") for v, t in pairs), len(words), 2)

    def _table(self, text: bytes, rows: int, columns: int) -> np.ndarray:
        """Parses numbers to (rows,columns)."""
        values = parse(self.path, text, np.int64)
        if values.size != rows * columns:
            raise UserError(f"{self.path}: a corner of a face is not written v, v/vt, v//vn or v/vt/vn")
        return values.reshape(rows, columns)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the numbers of corners (P,) of the polygons, and vertex and texture coordinate (N,2), -1 for none."""
        self._flush()
        if not self.corners:
            raise UserError(f"{self.path} has no faces: relight needs a surface")
        return np.concatenate(self.counts), np.concatenate(self.corners)


def parse(path: Path, text: bytes, type: type) -> np.ndarray:
    """Parses numbers between spaces; raises UserError if a word is no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy warns when it stops at a word that is no number
        try:
            return np.fromstring(text, type, sep=" ")
        except (DeprecationWarning, ValueError):
            raise UserError(
                f"{path} is not a whole .obj file: a line of `v`, `vt` or `f` is not made of numbers"
            ) from None


def read_obj(path: Path) -> RawMesh:
    """Reads triangles with uv per corner, material per face, and vertex colors (`v x y z r g b`, sRGB).

    Raises:
        UserError: if the file is malformed, or a .mtl file, a material or a texture that faces use is missing.
    """
    points, coordinates, faces = Numbers(path, "v", 3, 8), Numbers(path, "vt", 1, 2), Faces(path)
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
    color, notes = _colors(path, vertices, points.widest)
    numbers: dict[bytes, int] = {}  # of the materials, in the order of their first face
    runs = [(name, end - line) for (line, name), (end, _) in pairwise([*changes, (lines, b"")]) if end > line]
    used = np.repeat([numbers.setdefault(name, len(numbers)) for name, _ in runs], [length for _, length in runs])
    surfaces, told = read_libraries(path, libraries, [*numbers], color is not None)
    material = used[polygon]
    return without_tints(
        RawMesh(
            vertices=vertices[:, :3],
            faces=corners[:, 0][position],
            uv=_placed(path, uv, corners[:, 1][position], material, [*numbers], surfaces),
            material=material,
            materials=[surface.material for surface in surfaces],
            color=color,
            warnings=notes + told,
        )
    )


def _colors(path: Path, vertices: np.ndarray, widest: int) -> tuple[np.ndarray | None, list[str]]:
    """Returns the linear colors (V,3) that follow the coordinates x y z or x y z w, or None; and warnings."""
    columns = vertices.shape[1]
    if columns < 6:
        return None, ["some vertices have colors and others none: they are left out"] if widest >= 6 else []
    notes, first = [], 3
    if columns > 6:
        # x y z w r g b, as the standard has it, or x y z r g b a; alpha and w are mostly 1.
        ends = vertices[:, 6]
        alpha = columns == 7 and not (vertices[:, 3] == 1).all() and (ends == ends.max(initial=0)).all()
        first = 3 if alpha else 4
        said = "red, green, blue and alpha" if alpha else "a weight and red, green and blue"
        notes.append(f"the {columns - 3} numbers after the coordinates are taken as {said}")
    codes, unusual = unit_colors(vertices[:, first : first + 3], "its vertex colors")
    return linear(codes), notes + unusual


def _statements(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Yields keyword and rest of the lines; joins continued lines and skips comments and empty lines.

    Names may hold #, so a comment ends other statements only. A backslash continues no comment, which may end in a
    folder of Windows; nor a line after a byte of 128 or more, with which it is a character in Shift-JIS and others.
    """
    with open_lines(path) as file:
        while line := file.readline(MAX_LINE):
            while line.endswith(CONTINUED) and _goes_on(line) and len(line) < MAX_LINE:
                line = line.rstrip()[:-1] + b" " + file.readline(MAX_LINE)
            if len(line) >= MAX_LINE:
                raise UserError(f"{path} is not an .obj file: it has a line of over {MAX_LINE} bytes")
            words = line.split(None, 1)
            if words and words[0] not in KEYS:
                words[0] = words[0].lower().removeprefix(codecs.BOM_UTF8)  # in the middle of files that were joined
            if len(words) == 2:
                if b"#" in line and words[0] not in (b"usemtl", b"mtllib"):
                    words = [words[0], *line.split(b"#", 1)[0].split(None, 1)[1:]]
                if len(words) == 2:
                    yield words[0], words[1]
            elif words == [b"usemtl"]:
                yield words[0], b""


def _goes_on(line: bytes) -> bool:
    """Returns whether the backslash at the end of a line continues it."""
    return line.rstrip()[-2:-1] < b"\x80" and not line.lstrip().startswith(b"#")


def _placed(
    path: Path, uv: np.ndarray, corner: np.ndarray, material: np.ndarray, names: list[bytes], surfaces: list[Surface]
) -> np.ndarray | None:
    """Returns uv (F,3,2) with the placements of materials, or None; raises UserError if textured faces have none.

    Args:
        path: for error messages.
        uv: (T,1|2), the texture coordinates.
        corner: (F,3) the texture coordinate of each corner, -1 for none; it counts on textured faces only.
        material: (F,) of the faces.
        names: of the materials.
        surfaces: of the materials.
    """
    textured = np.array([one.material is not None and one.material.texture is not None for one in surfaces])[material]
    if not textured.any():
        return None
    used = corner[textured]
    if used.max() >= len(uv):
        raise UserError(f"{path}: a face names texture coordinate {used.max() + 1}, but there are {len(uv)}")
    if (used < 0).any():
        name = spellings(names[int(material[textured][(used < 0).any(axis=-1)][0])])[0]
        raise UserError(f"{path}: faces of the textured material {name!r} have no texture coordinates")
    placed = np.zeros((len(corner), 3, 2))
    placed[textured, :, : uv.shape[1]] = uv[used, :2]
    for index, surface in enumerate(surfaces):
        if surface.placement is not NO_PLACEMENT:
            faces = material == index
            placed[faces] = placed[faces] * surface.placement[:2] + surface.placement[2:]
    return placed
