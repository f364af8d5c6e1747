"""Reads mesh files of all supported formats."""

from collections.abc import Callable
from pathlib import Path

from relight.core.errors import UserError
from relight.core.files import existing_file, require_unpacked
from relight.meshes.gltf import read_gltf
from relight.meshes.mesh import Mesh
from relight.meshes.obj import read_obj
from relight.meshes.ply import read_ply
from relight.meshes.raw import RawMesh, checked_mesh


def read_stl(path: Path) -> RawMesh:
    """Reads triangles, ascii or binary, and joins corners at one point: STL has neither shared vertices nor colors.

    Raises:
        UserError: if the file is damaged.
    """
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False)
        mesh.merge_vertices()
    except Exception as error:  # trimesh raises several types
        raise UserError(f"{path} is damaged, or no STL ({error})") from None
    if not len(mesh.faces):
        raise UserError(f"{path} is damaged: it is cut short, or holds more than its triangles")
    return RawMesh(mesh.vertices, mesh.faces, [None])


READERS: dict[str, Callable[[Path], RawMesh]] = {
    ".ply": read_ply, ".obj": read_obj, ".glb": read_gltf, ".gltf": read_gltf, ".stl": read_stl,
}  # fmt: skip
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
    if (reader := READERS.get(path.suffix.lower())) is None:
        raise UserError(f"{path}: meshes of the kind {path.suffix or '(no suffix)'} are not read; {suffix_list()} are")
    if not (size := path.stat().st_size):
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
