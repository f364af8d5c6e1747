"""A mesh made ready for rays: checked, centred, in Open3D's ray caster (Embree)."""

import numpy as np
import open3d.core as o3c
from open3d.t.geometry import RaycastingScene

from relight.files import UserError

OFFSET = 6e-6  # of the bounding box's diagonal: ten times less leaks into the surface, ten times more out of creases
MISS = np.uint32(0xFFFFFFFF)


class Scene:
    """Ray casting against triangles `vertices` (V, 3), `faces` (F, 3), in the mesh's own units and frame.

    Rays are kept in float32 relative to the centre of the bounding box: Embree loses rays when a mesh is far from
    the origin (.4 % at 10 km). `threads` = 0 takes every core. Open3D holds Python's lock during a cast, so several
    figures at once take several processes, not threads.

    Embree drops bad triangles and calls bad rays unoccluded without a word, hence the checks. UserError when the mesh
    has no faces, a face names a vertex that does not exist, a used vertex is not finite, or no face has an area.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, threads: int = 0):
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
        self.corners = corners
        self.faces = faces
        self.areas = area[:, 0] / 2
        self.normals = np.divide(normals, area, out=np.zeros_like(normals), where=area > 0)  # (F, 3) geometric
        self.offset = OFFSET * self.diagonal
        self.threads = threads
        self.caster = RaycastingScene(nthreads=threads)
        self.caster.add_triangles(
            o3c.Tensor(np.ascontiguousarray(np.nan_to_num(vertices - self.centre), np.float32)),
            o3c.Tensor(np.ascontiguousarray(faces, np.uint32)),
        )

    def local(self, points: np.ndarray) -> np.ndarray:
        """Points of the mesh's frame in the caster's, float32."""
        return (points - self.centre).astype(np.float32)

    def occluded(self, rays: np.ndarray) -> np.ndarray:
        """Whether anything blocks each of the caster's rays (N, 6) float32: (N,) bool."""
        return self.caster.test_occlusions(o3c.Tensor.from_numpy(rays), nthreads=self.threads).numpy()

    def first(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What each of the caster's rays (N, 6) float32 meets first: face (N,) uint32, MISS where nothing is,
        and barycentric weights (N, 3) of the face's corners."""
        hits = self.caster.cast_rays(o3c.Tensor.from_numpy(rays), nthreads=self.threads)
        u, v = hits["primitive_uvs"].numpy().astype(np.float64).T
        return hits["primitive_ids"].numpy(), np.stack([1 - u - v, u, v], -1)

    def points(self, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Points (N, 3) float64 of the mesh's frame, from faces (N,) and barycentric weights (N, 3)."""
        return np.einsum("nc,ncx->nx", weights, self.corners[face])
