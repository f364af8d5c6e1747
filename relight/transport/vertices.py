"""Bakes light transport per vertex, for tools that shade meshes instead of images."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.maps import coefficient_names
from relight.maps.exr import CONVENTION
from relight.meshes import Mesh, vertex_normals
from relight.sh import order_of
from relight.transport.bounce import solve_radiosity
from relight.transport.integrate import integrate, require_at_least
from relight.transport.raycaster import RayCaster
from relight.transport.surface import sample_albedo

MIN_COSINE = 0.2  # between a normal of the file and that of the faces around the vertex
COLOR_STEP = 0.05  # between the albedos of a vertex's faces, from which they are reported as different
MIN_EXTENT = 1e-6  # units; products of the edges of smaller meshes underflow in single precision


@dataclass
class VertexTransport:
    """Transport at the vertices of a mesh, in its frame and units.

    Vertices that no face uses keep their position; their other values are zero.

    Attributes:
        vertices: (V,3) float32.
        faces: (F,3) int32.
        normals: (V,3) float32 unit normals, of the file where they fit its faces.
        albedo: (V,3) float32, linear.
        transport: (V,K) float32, direct, without 1/pi, index l*l + l + m.
        bounced: (V,K,3) float32 transport of the light that other surfaces reflect, or None without bounces.
        notes: sentences for the user; files do not hold them.
        origin: (3,) what is subtracted from the vertices of a file far from 0, or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    albedo: np.ndarray
    transport: np.ndarray
    bounced: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)
    origin: np.ndarray | None = None

    def save(self, path: Path | str) -> None:
        """Writes a file, whole or not at all.

        Args:
            path: .npz (the attributes by name), .ply (one vertex property per coefficient), or .glb (attributes _SH0
                ... _SH8, one per coefficient, _ALBEDO, linear, and _BOUNCED0 ...).

        Raises:
            UserError: if the path has another suffix.
        """
        path = Path(path)
        if (suffix := path.suffix.lower()) not in (".npz", ".ply", ".glb"):
            raise UserError(f"{path}: transport per vertex is written as .ply, .npz or .glb")
        with atomic_write(path) as temporary, open(temporary, "wb") as file:
            if suffix == ".npz":
                arrays: dict[str, Any] = {name: v for name, v in vars(self).items() if isinstance(v, np.ndarray)}
                np.savez(file, **arrays, convention=np.array(CONVENTION))
            else:
                file.write(self._ply() if suffix == ".ply" else self._glb())

    def _glb(self) -> bytes:
        import trimesh

        columns = {"_ALBEDO": self.albedo} | {f"_SH{k}": column for k, column in enumerate(self.transport.T)}
        if self.bounced is not None:
            columns |= {f"_BOUNCED{k}": self.bounced[:, k] for k in range(self.bounced.shape[1])}
        # By glTF 2.0, normals have unit length, and positions are numbers, also where no face uses the vertex.
        normals = np.where(self.normals.any(1, keepdims=True), self.normals, (0, 0, 1))
        mesh = trimesh.Trimesh(np.nan_to_num(self.vertices), self.faces, vertex_normals=normals, process=False)
        mesh.vertex_attributes.update({name: np.ascontiguousarray(column) for name, column in columns.items()})
        mesh.metadata["convention"] = CONVENTION
        return mesh.export(file_type="glb", include_normals=True)

    def _ply(self) -> bytes:
        """Returns a binary PLY whose vertices have x, nx, albedo_r (linear), L0M0, L1Mn1, bounced_r_L0M0 and so on."""
        names = coefficient_names(order_of(self.transport.shape[1]))
        columns = [*"xyz", "nx", "ny", "nz", "albedo_r", "albedo_g", "albedo_b", *names]
        parts = [self.vertices, self.normals, self.albedo, self.transport]
        if self.bounced is not None:
            columns += [f"bounced_{channel}_{name}" for channel in "rgb" for name in names]
            parts.append(self.bounced.transpose(0, 2, 1).reshape(len(self.vertices), -1))
        header = ["ply", "format binary_little_endian 1.0", f"comment {CONVENTION}"]
        header += [f"element vertex {len(self.vertices)}", *(f"property float {name}" for name in columns)]
        header += [f"element face {len(self.faces)}", "property list uchar int vertex_indices", "end_header", ""]
        faces = np.empty(len(self.faces), [("count", "u1"), ("index", "<i4", 3)])
        faces["count"], faces["index"] = 3, self.faces
        return "\n".join(header).encode() + np.concatenate(parts, 1).astype("<f4").tobytes() + faces.tobytes()


def bake_vertices(
    mesh: Mesh, rays: int, order: int = 2, seed: int = 0, bounces: int = 0, threads: int = 1
) -> VertexTransport:
    """Bakes the transport at every vertex, on the side of its normal, by the same integral as that of maps.

    Rays start slightly inside the faces that use a vertex. So where a floor ends at a wall, and the two share no
    vertices, each has the transport of its own side.

    Args:
        mesh: in any frame and unit. The albedo of a vertex is that of the first face that uses it.
        rays: per vertex.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.
        seed: random seed of the rays' azimuths.
        bounces: number of bounces of interreflection.
        threads: 0 takes every core. The result does not depend on it.

    Raises:
        UserError: if a setting is out of range or `RayCaster` rejects the mesh.
    """
    require_at_least(1, rays=rays)
    require_at_least(0, order=order, bounces=bounces)
    caster = RayCaster(mesh.vertices, mesh.faces, threads)
    if caster.diagonal < MIN_EXTENT:
        raise UserError(f"the mesh is {caster.diagonal:g} units large, and {MIN_EXTENT:g} are needed: scale it up")
    split_caster, radiosity = solve_radiosity(mesh, caster, rays, order, seed, bounces) if bounces else (caster, None)
    used, first_use = np.unique(mesh.faces.reshape(-1), return_index=True)
    normals = vertex_normals(mesh)[used].astype(np.float64)
    if mesh.normal is not None:  # those of the file, unless they are zero or point away from the faces
        given = mesh.normal[used].astype(np.float64)
        fits = np.einsum("vx,vx->v", given, normals) > MIN_COSINE * np.linalg.norm(given, axis=1)
        normals = np.where(fits[:, None], given, normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)  # to double precision
    points = _shifted_into_faces(caster, used, normals)
    transport, gathered = integrate(split_caster, points, normals, normals, rays, order, seed, radiosity)

    every = np.arange(len(mesh.faces))
    corners = [sample_albedo(mesh, every, np.broadcast_to(weights, (len(every), 3))) for weights in np.eye(3)]
    albedo = np.stack(corners, 1).reshape(-1, 3)  # at every corner of every face

    def scatter(values: np.ndarray) -> np.ndarray:
        array = np.zeros((len(mesh.vertices), *values.shape[1:]), np.float32)
        array[used] = values
        return array

    return VertexTransport(
        vertices=np.asarray(mesh.vertices, np.float32),
        faces=np.asarray(mesh.faces, np.int32),
        normals=scatter(normals),
        albedo=scatter(albedo[first_use]),
        transport=scatter(transport),
        bounced=None if gathered is None else scatter(gathered),
        notes=_color_notes(mesh.faces, scatter(albedo[first_use]), albedo),
        origin=np.array(mesh.info["origin"]) if "origin" in mesh.info else None,
    )


def _color_notes(faces: np.ndarray, chosen: np.ndarray, albedo: np.ndarray) -> list[str]:
    """Returns a note if vertices have faces of several colors, or an empty list.

    `chosen` (V,3) is the albedo of the vertices, and `albedo` (3F,3) that of the corners of the faces.
    """
    vertex = faces.reshape(-1)
    count = len(np.unique(vertex[(np.abs(albedo - chosen[vertex]) > COLOR_STEP).any(axis=1)]))
    if not count:
        return []
    return [
        f"{count:,} of {len(np.unique(vertex)):,} vertices have faces of several colors: each has the color of the "
        "first; split the mesh along its colors to keep them apart"
    ]


def _shifted_into_faces(caster: RayCaster, used: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Returns positions of vertices, moved into their faces, off the other surfaces that pass through them.

    The sum over a vertex's faces of the integral of the unit directions inside the face's angle vanishes where faces
    surround the vertex in a plane, and points inward from where they end. `used` (U,) are all vertices that faces use,
    ascending; their positions (U,3) in the mesh's frame are above each of the vertex's faces once `caster.offset` is
    added.
    """
    vertex = np.searchsorted(used, caster.faces)  # (F,3)
    points = np.empty((len(used), 3))
    points[vertex] = caster.corners
    sides = np.roll(caster.corners, -1, axis=1) - caster.corners
    length = np.linalg.norm(sides, axis=2, keepdims=True)
    sides = np.divide(sides, length, out=np.zeros_like(sides), where=length > 0)
    face_normals = np.broadcast_to(caster.normals[:, None], sides.shape)
    # The integral of the unit directions from a to b, counter-clockwise about n, is (b - a) x n.
    inside = np.cross(-np.roll(sides, 1, axis=1) - sides, face_normals)
    shift = np.zeros_like(points)
    np.add.at(shift, vertex, inside)
    shift -= np.minimum(np.einsum("ux,ux->u", shift, normals), 0)[:, None] * normals  # edges of solids: not inward
    # The sum is 2 at a straight edge. Times the offset, it is right in creases of over 27 degrees; with four times as
    # much, folds of generated figures differ more from their faces.
    shift *= caster.offset
    # A shift below the plane of one of the vertex's own faces may take half of the distance from it.
    descent = -np.einsum("fcx,fcx->fc", shift[vertex], face_normals)
    height = caster.offset * np.einsum("fcx,fcx->fc", normals[vertex], face_normals)
    share = np.ones(len(used))
    allowed = np.clip(height / 2, 0, None) / np.maximum(descent, 1e-300)
    np.minimum.at(share, vertex, np.where(descent > 0, allowed, 1))
    return points + share[:, None] * shift
