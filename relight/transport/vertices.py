"""Light transport per vertex, for tools that shade meshes rather than images."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from relight.files import UserError, whole
from relight.maps.exr import CONVENTION, coefficient_names
from relight.meshes.mesh import Mesh
from relight.meshes.normals import vertex_normals
from relight.sh.basis import order_of
from relight.transport.bounce import reflectors
from relight.transport.integrate import at_least, integrate
from relight.transport.scene import Scene
from relight.transport.surface import albedo

SMALLEST = 1e-6  # units: the extent from which on single precision is enough


@dataclass
class VertexTransport:
    """Transport at the vertices of a mesh, in its frame and units.

    vertices, normals, albedo (V, 3) float32, albedo linear; faces (F, 3) int32; transport (V, K) float32, direct, no
    1/pi, index l*l+l+m; bounced (V, K, 3) float32 or None, as in Maps. Vertices that no face uses have zeros but for
    their position.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    albedo: np.ndarray
    transport: np.ndarray
    bounced: np.ndarray | None = None

    def save(self, path: Path | str) -> None:
        """Writes .npz (the fields by name) or .ply (a vertex property per coefficient), whole or not at all."""
        path = Path(path)
        if path.suffix == ".npz":
            arrays = {name: value for name, value in vars(self).items() if value is not None}
            with whole(path) as temporary, open(temporary, "wb") as file:
                np.savez(file, **arrays, convention=np.array(CONVENTION))
        elif path.suffix == ".ply":
            with whole(path) as temporary:
                temporary.write_bytes(self._ply())
        else:
            raise UserError(f"{path}: transport per vertex is written as .ply or .npz")

    def _ply(self) -> bytes:
        """Binary PLY: position, normal, `albedo_r` ... linear, `L0M0`, `L1Mn1` ..., and `bounced_r_L0M0` ..."""
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
    """Transport at every vertex, on the side of its normal, by the integral that `bake` takes at pixels.

    The mesh needs no alignment. Albedo is that of the vertex in the first face that uses it. UserError as in `bake`.
    """
    at_least(1, rays=rays)
    at_least(0, order=order, bounces=bounces)
    given = mesh.vertices
    mesh = _at_least_visible(mesh)
    scene = Scene(mesh.vertices, mesh.faces, threads)
    lit, radiosity = reflectors(mesh, scene, rays, order, seed, bounces) if bounces else (scene, None)
    used, first = np.unique(mesh.faces.reshape(-1), return_index=True)
    face, corner = np.divmod(first, 3)
    normals = vertex_normals(mesh)[used].astype(np.float64)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)  # to double precision
    points = np.asarray(mesh.vertices, np.float64)[used]
    transport, gathered = integrate(lit, points, normals, normals, rays, order, seed, radiosity)

    def spread(values: np.ndarray) -> np.ndarray:
        whole_mesh = np.zeros((len(mesh.vertices), *values.shape[1:]), np.float32)
        whole_mesh[used] = values
        return whole_mesh

    return VertexTransport(
        vertices=np.asarray(given, np.float32),
        faces=np.asarray(mesh.faces, np.int32),
        normals=spread(normals),
        albedo=spread(albedo(mesh, face, np.eye(3)[corner])),
        transport=spread(transport),
        bounced=None if gathered is None else spread(gathered),
    )


def _at_least_visible(mesh: Mesh) -> Mesh:
    """`mesh`, or one that is too small for single precision scaled up by a power of two.

    Transport does not depend on the scale, and such a scaling rounds nothing. Normals and the ray caster multiply edges
    with each other: from 1e-12 units on the products are lost without a word.
    """
    finite = mesh.vertices[np.isfinite(mesh.vertices).all(axis=1)]
    extent = float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0
    if not 0 < extent < SMALLEST:
        return mesh
    return replace(mesh, vertices=np.asarray(mesh.vertices, np.float64) * 2.0 ** -np.floor(np.log2(extent)))
