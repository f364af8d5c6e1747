"""Reads mesh files of all supported formats."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import existing_file, require_unpacked
from relight.core.text import open_lines
from relight.meshes.geometry import joined
from relight.meshes.gltf import read_gltf
from relight.meshes.mesh import Mesh
from relight.meshes.obj import read_obj
from relight.meshes.ply import read_ply
from relight.meshes.raw import RawMesh, checked_mesh, parse_numbers

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])  # of a binary STL
FACET = re.compile(rb"(?mi)^[ \t]*(?:vertex\s(.*)|(end(?:loop|solid)))")  # names may hold these words as well


def read_stl(path: Path) -> RawMesh:
    """Reads triangles, ascii or binary, and joins corners at one point: STL has neither shared vertices nor colors.

    A file is binary if it has the bytes of the triangles that it promises: letters promise more than fit into any.

    Raises:
        UserError: if the file is damaged.
    """
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    if 0 < count <= (len(data) - 84) // RECORD.itemsize:
        corners = np.frombuffer(data, RECORD, count, offset=84)["corners"]
    else:
        with open_lines(path) as file:
            lines = FACET.findall(file.read())
        triples = [numbers for numbers, end in lines if not end]
        corners = parse_numbers(path, b" ".join(triples), np.float32)
        ends = [end.lower() for _, end in lines]
        if ends[-1:] != [b"endsolid"] or not len(corners) == 3 * len(triples) == 9 * ends.count(b"endloop"):
            raise UserError(f"{path} is cut short or damaged, or no STL")
    vertices, index = joined(corners.reshape(-1, 3))
    return RawMesh(vertices.astype(np.float64), index.reshape(-1, 3), [None])


READERS: dict[str, Callable[[Path], RawMesh]] = {
    ".ply": read_ply,
    ".obj": read_obj,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".stl": read_stl,
}
MAX_BYTES = 4 << 30  # an .obj of 20 million faces has about 2 GB


def read_mesh(path: Path | str) -> Mesh:
    """Reads a .ply, .obj (with .mtl and textures), .glb, .gltf or .stl file.

    Textures stay 8-bit sRGB, vertex colors become linear; polygons become triangles; the transforms of nodes are
    applied.

    Args:
        path: of the file.

    Returns:
        The mesh in the file's units and axes. Its info has name, source (the file's name) and warnings.

    Raises:
        UserError: if the file is missing, damaged, empty or too large, or names a texture that is missing.
    """
    path = existing_file(path, "mesh")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise UserError(f"{path}: meshes of the kind {path.suffix or '(no suffix)'} are not read; {suffix_list()} are")
    size = path.stat().st_size
    if not size:
        raise UserError(f"{path} is empty")
    if size > MAX_BYTES:
        raise UserError(f"{path} has {size / 2**30:.1f} GiB; up to {MAX_BYTES >> 30} GiB are read: decimate it first")
    require_unpacked(path)
    return checked_mesh(reader(path), path)


def suffix_list() -> str:
    """Returns the supported suffixes as text.

    >>> suffix_list()
    '.ply, .obj, .glb, .gltf and .stl'
    """
    *most, last = READERS
    return f"{', '.join(most)} and {last}"
