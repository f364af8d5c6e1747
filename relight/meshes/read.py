"""A user's mesh file as a mesh record."""

from collections.abc import Callable
from pathlib import Path

from relight.files import UserError, existing
from relight.meshes.gltf import read_gltf
from relight.meshes.mesh import Mesh
from relight.meshes.obj import read_obj
from relight.meshes.ply import read_ply
from relight.meshes.source import Source, record

READERS: dict[str, Callable[[Path], Source]] = {
    ".ply": read_ply,
    ".obj": read_obj,
    ".glb": read_gltf,
    ".gltf": read_gltf,
}
MAX_BYTES = 4 << 30  # an .obj of 20 million faces has about 2 GB


def read_mesh(path: Path | str) -> Mesh:
    """Reads a .ply, .obj (with .mtl and textures), .glb or .gltf file.

    Units and axes stay the file's (`align` finds them); textures stay 8-bit sRGB, vertex colours become linear;
    polygons become triangles; every node's transform is applied. info: name, source (the file's name), warnings.
    Raises UserError with one sentence for a file that is missing, damaged, empty, or lacks a texture that it names.
    """
    path = existing(path, "mesh")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise UserError(f"{path}: meshes of the kind {path.suffix or '(no suffix)'} are not read; {kinds()} are")
    size = path.stat().st_size
    if not size:
        raise UserError(f"{path} is empty")
    if size > MAX_BYTES:
        raise UserError(
            f"{path} has {size / 2**30:.1f} GiB; files up to {MAX_BYTES >> 30} GiB are read: decimate it first"
        )
    return record(reader(path), path)


def kinds() -> str:
    """The suffixes that are read, as one says them."""
    *most, last = READERS
    return f"{', '.join(most)} and {last}"
