"""Reads PLY files, ascii and binary, with vertex colors and the texture coordinates that MeshLab writes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.text import spellings
from relight.meshes.find import find_file
from relight.meshes.mesh import Material
from relight.meshes.ply_file import Block, ListColumn, read_blocks
from relight.meshes.polygons import triangulate
from relight.meshes.raw import RawMesh, linear, unit_colors, without_tints
from relight.pictures.texture import read_texture

COLORS = [
    [prefix + name for name in names] for prefix in ("", "diffuse_") for names in (("red", "green", "blue"), "rgb")
]
COORDINATES = ("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("tx", "ty")


def read_ply(path: Path) -> RawMesh:
    """Reads triangles, into which polygons are cut, with colors, uv and textures.

    Raises:
        UserError: if the file is malformed or has no faces, or a texture is missing or damaged.
    """
    blocks, textures = read_blocks(path)
    vertex, face = blocks.get("vertex", {}), blocks.get("face", {})
    if (points := _columns(vertex, "xyz")) is None:
        raise UserError(f"{path} has no vertices with x, y and z")
    corners = next((face[name] for name in ("vertex_indices", "vertex_index") if name in face), None)
    if corners is None or not len(corners.lengths):
        kind = "strips of triangles" if "tristrips" in blocks else "points"
        raise UserError(f"{path} has {kind} but no faces: relight needs a surface; save it with faces, as MeshLab does")
    counts, vertices = corners.lengths, points.astype(np.float64)
    index = corners.values if corners.values.dtype.kind in "iu" else corners.values.astype(np.int64)
    position, polygon = triangulate(path, counts, index, vertices)
    materials: list[Material | None] = [
        Material(texture=read_texture(find_file(path, name), f"{path}: texture {spellings(name)[0]}"))
        for name in textures
    ]
    faces, is_numbered = index[position], len(materials) > ("texnumber" not in face)
    raw = RawMesh(
        vertices=vertices,
        faces=faces,
        uv=_texture_coordinates(path, vertex, face, counts, position, faces) if textures else None,
        material=_texture_numbers(path, face, materials)[polygon] if is_numbered else None,
        materials=materials or [None],
        normal=_columns(vertex, ("nx", "ny", "nz")),
    )
    if not textures and any("texcoord" in face or vertex.keys() >= {*names} for names in COORDINATES):
        raw.warnings.append("it has texture coordinates but names no texture (`comment TextureFile skin.png`)")
    vertex_color, face_color = _color(vertex, raw.warnings), _color(face, raw.warnings)
    if vertex_color is not None:
        raw.color = vertex_color[faces]
        if face_color is not None:
            raw.warnings.append("its colors of faces are left out: the vertices have colors")
    elif face_color is not None:
        raw.color = face_color[polygon][:, None].repeat(3, axis=1)
    return without_tints(raw)


def _columns(block: Block, names: Iterable[str]) -> np.ndarray | None:
    """Returns the columns of these names (N,columns), or None if the block lacks one or it holds lists."""
    columns: list[Any] = [block.get(name) for name in names]
    return np.stack(columns, axis=-1) if all(isinstance(column, np.ndarray) for column in columns) else None


def _color(block: Block, warnings: list[str]) -> np.ndarray | None:
    """Returns linear colors (N,3) of vertices or faces, None if there are none; `warnings` gets what is unusual."""
    for names in COLORS:
        if (colors := _columns(block, names)) is not None:
            if len({block[name].dtype.kind == "f" for name in names}) > 1:
                warnings.append(f"{', '.join(names)} are of different types: its colors are left out")
                return None
            codes, notes = unit_colors(colors, "its colors")
            warnings += notes
            return linear(codes)
    return None


def _texture_numbers(path: Path, face: Block, materials: list[Material | None]) -> np.ndarray:
    """Returns the number of the texture of each face before polygons are cut, (F,).

    `materials` has one for each texture, and gets a further one, None, if a face has the number -1: no texture. Raises
    UserError if faces have no number, or one that no texture has.
    """
    numbers = face.get("texnumber")
    if numbers is None or isinstance(numbers, ListColumn):
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
    """Returns uv (F,3,2) from MeshLab's list per face (u v of each corner), or from coordinates per vertex."""
    if "texcoord" in face:
        if not np.array_equal(face["texcoord"].lengths, 2 * counts):
            raise UserError(f"{path}: `texcoord` must hold two numbers per corner of each face")
        return face["texcoord"].values.reshape(-1, 2)[position]
    for names in COORDINATES:
        uv = _columns(vertex, names)
        if uv is not None and faces.max() < len(uv) and faces.min() >= 0:
            return uv[faces]
    raise UserError(f"{path} names a texture but has no texture coordinates")
