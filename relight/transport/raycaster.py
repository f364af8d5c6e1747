"""Casts rays against a mesh by Open3D (Embree)."""

import numpy as np

from relight.core.errors import UserError
from relight.core.libraries import with_libraries

open3d = with_libraries("open3d")

# Distance of ray origins from the surface, over the diagonal of the bounding box: a tenth of it causes self-shadowing,
# ten times as much leaks light into creases.
OFFSET = 6e-6
MISS = np.uint32(0xFFFFFFFF)  # face index of a ray that hits nothing


class RayCaster:
    """Casts rays against triangles.

    Rays are float32, relative to the centre of the bounding box, since Embree loses rays far from the origin (.4 % at
    10 km). Open3D holds the GIL during a cast, so figures are baked in parallel by processes, not threads.

    Attributes:
        faces: (F,3) indices of vertices.
        corners: (F,3,3) float64 positions of the faces' vertices.
        normals: (F,3) float64 unit geometric normals, counter-clockwise outward; zero for faces without area.
        areas: (F,) float64 of the faces.
        low, high, centre: (3,) float64 of the bounding box.
        diagonal: length of the bounding box's diagonal, in the units of the vertices.
        offset: distance from the surface at which rays start, in the same units.
        threads: 0 takes every core.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, threads: int = 0):
        """Checks the mesh and builds the acceleration structure.

        The checks are needed because Embree silently drops invalid triangles and reports invalid rays as unoccluded.

        Args:
            vertices: (V,3), in any frame and unit.
            faces: (F,3).
            threads: 0 takes every core.

        Raises:
            UserError: if there are no faces, if a face names a vertex that does not exist or is not finite, or if no
                face has an area.
        """
        vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces)
        if len(faces) == 0:
            raise UserError("the mesh has no faces: a transport baker needs triangles")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise UserError(f"the mesh has {len(vertices)} vertices but its faces use {faces.min()} to {faces.max()}")
        corners = vertices[faces]
        bad = ~np.isfinite(corners).all(axis=(1, 2))
        if bad.any():
            raise UserError(f"{bad.sum()} of the mesh's {len(faces)} faces have a vertex that is not finite: repair it")
        self.low, self.high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.centre = (self.low + self.high) / 2
        self.diagonal = float(np.linalg.norm(self.high - self.low))
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(normals, axis=1, keepdims=True)
        if not area.any():
            raise UserError(f"all {len(faces)} faces of the mesh are degenerate: none has an area")
        self.corners, self.faces, self.threads = corners, faces, threads
        self.areas = area[:, 0] / 2
        self.normals = np.divide(normals, area, out=np.zeros_like(normals), where=area > 0)
        self.offset = OFFSET * self.diagonal
        self._scene = open3d.t.geometry.RaycastingScene(nthreads=threads)
        self._scene.add_triangles(
            open3d.core.Tensor(np.ascontiguousarray(np.nan_to_num(vertices - self.centre), np.float32)),
            open3d.core.Tensor(np.ascontiguousarray(faces, np.uint32)),
        )

    def to_local(self, points: np.ndarray) -> np.ndarray:
        """Converts points (...,3) of the mesh's frame to float32 ray coordinates, relative to the centre."""
        return (points - self.centre).astype(np.float32)

    def occluded(self, rays: np.ndarray) -> np.ndarray:
        """Returns whether rays (N,6) float32, origin relative to the centre and direction, hit any face, (N,) bool."""
        return self._scene.test_occlusions(open3d.core.Tensor.from_numpy(rays), nthreads=self.threads).numpy()

    def intersect(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Finds the first intersections of rays.

        Args:
            rays: (N,6) float32, origin relative to the centre and direction.

        Returns:
            Face (N,) uint32, MISS where there is none, and barycentric weights (N,3) of its corners.
        """
        hits = self._scene.cast_rays(open3d.core.Tensor.from_numpy(rays), nthreads=self.threads)
        u, v = hits["primitive_uvs"].numpy().astype(np.float64).T
        return hits["primitive_ids"].numpy(), np.stack([1 - u - v, u, v], -1)

    def points(self, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Returns points (N,3) float64 of the mesh's frame at faces (N,) and barycentric weights (N,3)."""
        return np.einsum("nc,ncx->nx", weights, self.corners[face])
