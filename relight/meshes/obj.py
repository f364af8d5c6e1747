"""Reads Wavefront OBJ files and their materials."""

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from relight.files import UserError
from relight.meshes.mesh import Material
from relight.meshes.mtl import Library, find_file, read_mtl
from relight.meshes.raw import RawMesh, fan, linear

CHUNK = 1 << 17  # lines that are parsed at a time, so that 5 million faces never exist as text objects
MAX_LINE = 1 << 20  # bytes; a file with a longer line is no text


class Numbers:
    """Collects lines of numbers and parses them in chunks, to rows of `least` to `most` columns.

    Attributes:
        count: number of the lines.
    """

    def __init__(self, path: Path, what: str, least: int, most: int):
        self.path, self.what, self.least, self.most = path, what, least, most
        self.lines: list[bytes] = []
        self.rows: list[np.ndarray] = []
        self.count = 0

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
        values = parse(self.path, b" ".join(self.lines), np.float64)
        if values.size != width * len(self.lines):  # some lines are longer than others
            width = min(len(line.split()) for line in self.lines)
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
        if alike and form == 2 and text.count(b"//") == len(words):
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
    """Reads triangles with uv per corner, material per face, and vertex colours (`v x y z r g b`, sRGB).

    Raises:
        UserError: if the file is malformed, or a .mtl file, a material or a texture is missing.
    """
    points, coordinates, faces = Numbers(path, "v", 3, 6), Numbers(path, "vt", 1, 2), Faces(path)
    names: list[str] = []  # materials in the order of their first use
    libraries: list[str] = []
    changes: list[tuple[int, int]] = []  # (face line, index into names) where `usemtl` changes the material
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
            name = rest.decode("utf-8", "replace").strip()
            if name not in names:
                names.append(name)
            changes.append((lines, names.index(name)))
        elif key == b"mtllib":
            libraries.append(rest.decode("utf-8", "replace").strip())
    vertices, uv = points.array(), coordinates.array()
    counts, corners = faces.arrays()
    position, polygon = fan(counts)
    library, notes = _library(path, libraries, names)
    used = np.zeros(lines, np.int64)
    for line, index in changes:
        used[line:] = index
    materials = [library.materials[name] for name in names] if library.materials else [Material()]
    material = used[polygon] if library.materials else np.zeros(len(polygon), np.int64)
    corner = corners[:, 1][position]
    if corner.size and corner.max() >= len(uv):
        raise UserError(f"{path}: a face names texture coordinate {corner.max() + 1}, but there are {len(uv)}")
    color = vertices[:, 3:6] if vertices.shape[1] == 6 else None
    if color is not None and np.nanmax(color, initial=0) > 1:
        color = color / 255
    if color is None and not library.materials:
        notes.append("the file has neither materials nor vertex colours: the albedo is white")
    return RawMesh(
        vertices=vertices[:, :3],
        faces=corners[:, 0][position],
        uv=_placed(path, uv, corner, material, materials, names, library) if library.materials else None,
        material=material,
        materials=materials,
        color=None if color is None else linear(color),
        warnings=notes,
    )


def _statements(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Yields keyword and rest of the lines; joins continued lines and skips comments and empty lines."""
    with open(path, "rb") as file:
        while line := file.readline(MAX_LINE):
            if len(line) == MAX_LINE:
                raise UserError(f"{path} is not an .obj file: it has a line of over {MAX_LINE} bytes")
            while line.rstrip(b"\r\n").endswith(b"\\") and (more := file.readline(MAX_LINE)):
                line = line.rstrip(b"\r\n")[:-1] + b" " + more
                if len(line) > MAX_LINE:
                    raise UserError(f"{path} is not an .obj file: it has a line of over {MAX_LINE} bytes")
            words = line.split(b"#", 1)[0].split(None, 1) if b"#" in line else line.split(None, 1)
            if len(words) == 2:
                yield words[0], words[1]


def _library(path: Path, libraries: list[str], names: list[str]) -> tuple[Library, list[str]]:
    """Reads the materials of all libraries; raises UserError if one that is used is missing. Also returns warnings."""
    library, notes = Library({}, {}), []
    for text in libraries:
        try:
            files = [find_file(path, text)]  # one name with spaces in it, or several names
        except UserError:
            if len(text.split()) == 1:
                raise
            files = [find_file(path, name) for name in text.split()]
        for file in files:
            read = read_mtl(file)
            library.materials.update(read.materials)
            library.placement.update(read.placement)
    if libraries:
        missing = [name for name in names if name not in library.materials]
        if missing:
            raise UserError(f"{path} uses the material {missing[0]!r}, which {', '.join(libraries)} does not define")
    elif names:
        notes.append("the file uses materials but names no .mtl file: they are left out")
    if not names:
        return Library({}, {}), notes
    return library, notes


def _placed(
    path: Path,
    uv: np.ndarray,
    corner: np.ndarray,
    material: np.ndarray,
    materials: list[Material],
    names: list[str],
    library: Library,
) -> np.ndarray:
    """Returns uv (F,3,2) with the placements of materials; raises UserError if textured faces have none."""
    textured = np.array([entry.texture is not None for entry in materials])[material]
    if (corner[textured] < 0).any():
        name = names[int(material[textured & (corner < 0).any(axis=-1)][0])]
        raise UserError(f"{path}: faces of the textured material {name!r} have no texture coordinates")
    uv = np.concatenate([np.pad(uv[:, :2], ((0, 0), (0, 2 - uv.shape[1]))), np.zeros((1, 2))])  # the last is for -1
    placed = uv[corner]
    for index, name in enumerate(names):
        if name in library.placement:
            faces = material == index
            scale, offset = library.placement[name][:2], library.placement[name][2:]
            placed[faces] = placed[faces] * scale + offset
    return placed
