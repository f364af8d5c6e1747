"""Reads PLY files, ascii and binary, with vertex colors and the texture coordinates that MeshLab writes."""

import codecs
import re
import struct
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.errors import UserError
from relight.meshes.find import find_file
from relight.meshes.mesh import Material
from relight.meshes.polygons import triangulate
from relight.meshes.raw import RawMesh, linear, read_texture, unit_colors, without_tints
from relight.text import spellings

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
FORMATS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
HEADER = 1 << 20  # bytes; real headers have under a thousand
COLORS = [
    [prefix + name for name in names] for prefix in ("", "diffuse_") for names in (("red", "green", "blue"), "rgb")
]
COORDINATES = ("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("tx", "ty")
Block = dict[str, Any]  # columns by property: (N,), or of a list its lengths (N,) and its values one after another


@dataclass
class Element:
    """One element of the header.

    Attributes:
        name: such as `vertex`.
        count: of its rows.
        properties: name, type, and type of a list's length or None, in the file's order.
    """

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)

    def least_bytes(self, ascii: bool) -> int:
        """Returns the size of the shortest row: a list may be empty, an ascii value is a digit and a space."""
        return sum(2 if ascii else np.dtype(size or type).itemsize for _, type, size in self.properties)


def read_ply(path: Path) -> RawMesh:
    """Reads triangles; polygons are cut. Raises UserError if the file is malformed."""
    data = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    order, elements, pictures, start = _header(path, data[:HEADER])
    needed = sum(element.count * element.least_bytes(ascii=order is None) for element in elements)
    if needed > len(data) - start + (order is None):  # checked before such an array is allocated
        counts = " and ".join(f"{element.count} {element.name} rows" for element in elements)
        raise UserError(
            f"{path}: the header promises {counts}, which the {len(data) - start} bytes after it cannot hold"
        )
    if order is None:
        blocks = _ascii_blocks(path, data[start:], elements)
    else:
        blocks = _blocks(path, data, start, order, elements)
    vertex, face = blocks.get("vertex"), blocks.get("face", {})
    if not vertex or not {"x", "y", "z"} <= vertex.keys():
        raise UserError(f"{path} has no vertices with x, y and z")
    corners = next((face[name] for name in ("vertex_indices", "vertex_index") if name in face), None)
    if "tristrips" in blocks and (corners is None or not len(corners[0])):
        raise UserError(f"{path} holds its surface as strips of triangles: save it with faces, such as by MeshLab")
    if corners is None or not len(corners[0]):
        raise UserError(f"{path} has points but no faces: relight needs a surface")
    counts, index = corners[0], corners[1] if corners[1].dtype.kind in "iu" else corners[1].astype(np.int64)
    vertices = np.stack([vertex[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    position, polygon = triangulate(path, counts, index, vertices)
    materials: list[Material | None] = [
        Material(texture=read_texture(find_file(path, name), f"{path}: texture {spellings(name)[0]}"))
        for name in pictures
    ]
    faces = index[position]
    raw = RawMesh(
        vertices=vertices,
        faces=faces,
        uv=_texture_coordinates(path, vertex, face, counts, position, faces) if pictures else None,
        material=_texture_numbers(path, face, materials)[polygon] if len(materials) > 1 else None,
        materials=materials or [None],
    )
    if not pictures and any("texcoord" in face or vertex.keys() >= {*names} for names in COORDINATES):
        raw.warnings.append("it has texture coordinates but names no texture (`comment TextureFile skin.png`)")
    raw.color = _color(vertex, raw.warnings)
    of_faces = _color(face, raw.warnings)
    if of_faces is not None and raw.color is not None:
        raw.warnings.append("its colors of faces are left out: the vertices have colors")
    elif of_faces is not None:
        raw = _with_face_colors(raw, of_faces[polygon])
    return without_tints(raw)


def _with_face_colors(raw: RawMesh, color: np.ndarray) -> RawMesh:
    """Gives vertices the colors (F,3) of their faces; one that joins several colors is repeated for each."""
    _, number = np.unique(color, axis=0, return_inverse=True)
    corner = raw.faces.astype(np.int64) * (int(number.max()) + 1) + number.reshape(-1, 1)
    _, first, faces = np.unique(corner, return_index=True, return_inverse=True)
    vertices = raw.vertices[raw.faces.reshape(-1)[first]]
    return replace(raw, vertices=vertices, faces=faces.reshape(-1, 3), color=color[first // 3])


def _header(path: Path, head: bytes) -> tuple[str | None, list[Element], list[bytes], int]:
    """Parses byte order (None for ascii), elements, names of textures, and where the data begin."""
    end = head.find(b"end_header")
    first = re.match(rb"ply[ \t]*(\r\n|\n|\r)", head)  # all lines of a header end as the first one does
    line_end = head.find(first[1], end) if first else -1
    if first is None or end < 0 or line_end < 0:
        raise UserError(f"{path} is not a PLY file: it lacks the line `ply` at the top or the line `end_header`")
    format, elements, pictures = "", [], []
    for line in head[:end].decode("latin-1").split(first[1].decode())[1:]:
        words = line.split()
        try:
            match words:
                case ["format", name, *_]:
                    format = name
                case ["comment", "TextureFile", *_]:
                    pictures.append(line.split("TextureFile", 1)[1].strip().strip('"').encode("latin-1"))
                case ["element", name, count]:
                    elements.append(Element(name, int(count)))
                    if elements[-1].count < 0:
                        raise ValueError
                case ["property", "list", size, type, name]:
                    elements[-1].properties.append((name.lower(), TYPES[type], TYPES[size]))
                case ["property", type, name]:
                    elements[-1].properties.append((name.lower(), TYPES[type], None))
                case ["comment" | "obj_info", *_] | []:
                    pass
                case _:
                    raise ValueError
        except (KeyError, ValueError, IndexError):
            raise UserError(f"{path}: the PLY header's line {line.strip()[:80]!r} means nothing") from None
    if format not in FORMATS:
        raise UserError(f"{path}: PLY format {format or 'missing'}; {', '.join(FORMATS)} are read")
    for element in elements:
        names = [name for name, _, _ in element.properties]
        if len(set(names)) < len(names):
            raise UserError(f"{path}: the PLY header names a property of {element.name} twice")
    return FORMATS[format], [element for element in elements if element.properties], pictures, line_end + len(first[1])


def _blocks(path: Path, data: bytes, start: int, order: str, elements: list[Element]) -> dict[str, Block]:
    """Parses binary data to columns by element."""
    blocks = {}
    for element in elements:
        lengths = _first_lengths(path, data, start, order, element)
        fields = []
        for (name, type, size), length in zip(element.properties, lengths):
            if size:
                fields += [(f"{name} length", order + size), (name, order + type, (length,))]
            else:
                fields.append((name, order + type))
        row = np.dtype(fields)
        fits = start + element.count * row.itemsize <= len(data)
        table = np.frombuffer(data, row, element.count, start) if fits else None
        names = [name for name, _, size in element.properties if size]
        if table is not None and all((table[f"{n} length"] == table[f"{n} length"][:1]).all() for n in names):
            blocks[element.name] = {
                name: (np.full(element.count, length), table[name].reshape(-1)) if size else table[name]
                for (name, _, size), length in zip(element.properties, lengths)
            }
            start += element.count * row.itemsize
        else:
            blocks[element.name], start = _ragged(path, data, start, order, element)
    return blocks


def _first_lengths(path: Path, data: bytes, start: int, order: str, element: Element) -> list[int]:
    """Returns the lengths of the first row's lists, 0 for scalars; in nearly all files every row has the same."""
    lengths = []
    for _, type, size in element.properties:
        length = 0
        if size and element.count:
            length = _unpack(path, data, start, order + size, 1, element)[0]
            start += np.dtype(size).itemsize
            if not 0 <= length <= len(data):
                raise UserError(f"{path}: a list of {length} values in {element.name}; the file is damaged")
        lengths.append(int(length))
        start += np.dtype(type).itemsize * (int(length) if size else 1)
    return lengths


def _unpack(path: Path, data: bytes, start: int, type: str, count: int, element: Element) -> tuple[Any, ...]:
    """Unpacks `count` values; raises UserError if the data end before."""
    try:
        return struct.unpack_from(f"{type[0]}{count}{np.dtype(type).char}", data, start)
    except (struct.error, OverflowError):
        raise UserError(f"{path} ends in the middle of its {element.name} data: it is truncated") from None


def _ragged(path: Path, data: bytes, start: int, order: str, element: Element) -> tuple[Block, int]:
    """Parses an element whose rows have lists of different lengths, row by row; also returns where it ends."""
    columns: dict[str, Any] = {name: ([], []) if size else [] for name, _, size in element.properties}
    widths = [(name, order + type, order + size if size else None) for name, type, size in element.properties]
    for _ in range(element.count):
        for name, type, size in widths:
            length = 1
            if size:
                length = _unpack(path, data, start, size, 1, element)[0]
                start += np.dtype(size).itemsize
                if not 0 <= length <= len(data):  # also true of NaN, in ascii files
                    raise UserError(f"{path}: a list of {length} values in {element.name}; the file is damaged")
                length = int(length)
                columns[name][0].append(length)
            values = _unpack(path, data, start, type, length, element)
            start += np.dtype(type).itemsize * length
            (columns[name][1] if size else columns[name]).extend(values)
    return {
        name: tuple(np.array(part) for part in column) if isinstance(column, tuple) else np.array(column)
        for name, column in columns.items()
    }, start


def _ascii_blocks(path: Path, text: bytes, elements: list[Element]) -> dict[str, Block]:
    """Parses ascii data: converts them to binary doubles and parses those."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy warns when it stops at a word that is no number
        try:
            values = np.fromstring(text, np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            raise UserError(f"{path}: the data of this ascii PLY hold something that is not a number") from None
    doubles = [
        Element(element.name, element.count, [(name, "f8", size and "f8") for name, _, size in element.properties])
        for element in elements
    ]
    kinds = {(element.name, name): type for element in elements for name, type, _ in element.properties}
    blocks = _blocks(path, values.astype("<f8").tobytes(), 0, "<", doubles)
    return {
        block: {
            name: (column[0].astype(np.int64), column[1])
            if isinstance(column, tuple)
            else _as_declared(column, kinds[block, name])
            for name, column in columns.items()
        }
        for block, columns in blocks.items()
    }


def _as_declared(column: np.ndarray, kind: str) -> np.ndarray:
    """Returns doubles as the integers that they were declared, or wider ones where they do not fit."""
    if kind[0] == "f" or not np.isfinite(column).all() or np.abs(column).max(initial=0) > 2**53:
        return column
    limits = np.iinfo(kind)
    fits = column.min(initial=0) >= limits.min and column.max(initial=0) <= limits.max
    return column.astype(kind if fits else np.int64)


def _color(block: Block, warnings: list[str]) -> np.ndarray | None:
    """Returns linear colors (N,3) from the columns of vertices or faces, sRGB of any type, or None."""
    for names in COLORS:
        if all(name in block and not isinstance(block[name], tuple) for name in names):
            if len({block[name].dtype.kind == "f" for name in names}) > 1:
                warnings.append(f"{', '.join(names)} are of different types: its colors are left out")
                return None
            codes, notes = unit_colors(np.stack([block[name] for name in names], axis=-1), "its colors")
            warnings += notes
            return linear(codes)
    return None


def _texture_numbers(path: Path, face: Block, materials: list[Material | None]) -> np.ndarray:
    """Returns the number of the texture of each face (F,); a material of its own, without color, is added for -1."""
    numbers = face.get("texnumber")
    if numbers is None or isinstance(numbers, tuple):
        raise UserError(f"{path} names {len(materials)} textures, but its faces have no `texnumber` that says which")
    if numbers.min() < -1 or numbers.max() >= len(materials):
        wrong = numbers.min() if numbers.min() < -1 else numbers.max()
        raise UserError(f"{path}: a face has texture {wrong:g} (counted from 0), but there are {len(materials)}")
    count = len(materials)
    if numbers.min() == -1:
        materials.append(None)
    return np.where(numbers < 0, count, numbers).astype(np.int64)


def _texture_coordinates(
    path: Path, vertex: Block, face: Block, counts: np.ndarray, position: np.ndarray, faces: np.ndarray
) -> np.ndarray:
    """Returns uv (F,3,2) from MeshLab's list per face (u v of each corner) or from coordinates per vertex."""
    if "texcoord" in face:
        lengths, values = face["texcoord"]
        if not np.array_equal(lengths, 2 * counts):
            raise UserError(f"{path}: `texcoord` must hold two numbers per corner of each face")
        return values.reshape(-1, 2)[position]
    for names in COORDINATES:
        if all(name in vertex for name in names) and faces.max() < len(vertex["x"]) and faces.min() >= 0:
            return np.stack([vertex[name] for name in names], axis=-1)[faces]
    raise UserError(f"{path} names a texture but has no texture coordinates")
