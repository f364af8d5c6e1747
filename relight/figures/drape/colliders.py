"""Warp's setup, and collision meshes: nearest faces and ray casts."""

import os

import numpy as np
import warp as wp
from platformdirs import user_cache_path

from relight.core.processes import without_messages
from relight.figures.drape.kernels import cast_rays, find_nearest_faces
from relight.figures.surfaces import normals, unit_rows

wp.config.log_level = wp.LOG_ERROR


def init_warp() -> None:
    """Initialises Warp on the CPU, with compiled kernels in relight's cache folder (moved by RELIGHT_CACHE)."""
    folder = os.environ.get("RELIGHT_CACHE") or user_cache_path("relight")
    wp.config.kernel_cache_dir = os.path.join(str(folder), "warp")
    with without_messages():  # of a missing CUDA driver
        wp.init()
    wp.set_device("cpu")


def vec3_array(values: np.ndarray) -> wp.array:
    """Returns points (n,3) as a Warp array."""
    return wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.vec3)


class Collider:
    """A closed or open mesh that moves from `start` to `end` during a frame; for a mesh at rest, both are the same.

    Nearest faces and ray hits are searched on `start`, where cloth still is: limbs move further in a frame than they
    are thick.

    Attributes:
        indices: (3 F,) vertices of the faces.
        start, end: Warp's arrays of them.
        normals: (V,3) unit vertex normals at the end.
        mesh: Warp's mesh of `start`.
    """

    def __init__(self, start: np.ndarray, end: np.ndarray, faces: np.ndarray):
        """Builds the search structure from vertices (V,3) at both ends of the frame, metres, and faces (F,3)."""
        self.indices: wp.array = wp.array(faces.astype(np.int32).ravel(), dtype=int)
        self.start, self.end = vec3_array(start), vec3_array(end)
        self.normals = vec3_array(normals(end, faces))  # those of its end, for the whole frame
        self.mesh = wp.Mesh(points=self.start, indices=self.indices)

    @classmethod
    def at_rest(cls, vertices: np.ndarray, faces: np.ndarray) -> "Collider":
        """Returns the collider of vertices (V,3), metres, and faces (F,3) that do not move."""
        return cls(vertices, vertices, faces)

    def nearest(self, points: np.ndarray, max_distance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Finds the nearest face of `start` for each point.

        Args:
            points: (n,3) metres.
            max_distance: metres beyond which no face is searched.

        Returns:
            The face (n,), -1 beyond `max_distance`; the nearest point (n,3) on it, where it is at the end, metres; the
            unit normal (n,3) there.
        """
        face = wp.zeros(len(points), dtype=int)
        barycentric = wp.zeros(len(points), dtype=wp.vec2)
        inputs = [self.mesh.id, vec3_array(points), max_distance, face, barycentric]
        wp.launch(find_nearest_faces, dim=len(points), inputs=inputs)
        weights = barycentric.numpy().astype(float)
        weights = np.c_[weights, 1 - weights.sum(1)]
        corner = self.indices.numpy().reshape(-1, 3)[face.numpy()]
        place, normal = (np.einsum("nk,nkd->nd", weights, of.numpy()[corner]) for of in (self.end, self.normals))
        return face.numpy(), place, unit_rows(normal)

    def raycast(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Casts rays from origins (n,3) in unit directions, (n,3) or one for all (3,).

        Returns:
            The first face (n,) that each ray hits, -1 for none, and its distance (n,) in metres, infinite for none.
        """
        face = wp.zeros(len(origin), dtype=int)
        depth = wp.zeros(len(origin), dtype=float)
        directions = np.broadcast_to(direction, origin.shape)
        inputs = [self.mesh.id, vec3_array(origin), vec3_array(directions), face, depth]
        wp.launch(cast_rays, dim=len(origin), inputs=inputs)
        return face.numpy(), np.where(face.numpy() >= 0, depth.numpy().astype(float), np.inf)


def signed_distance(
    points: np.ndarray, surface: Collider, max_distance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Computes the signed distance of points from a surface.

    Args:
        points: (n,3) metres.
        surface: its faces turn outward.
        max_distance: metres beyond which no face is searched.

    Returns:
        The nearest face (n,), -1 beyond `max_distance`; the distance (n,), positive outside, infinite beyond it; the
        unit normal (n,3) of the surface there.
    """
    face, place, normal = surface.nearest(points, max_distance)
    return face, np.where(face >= 0, np.einsum("nd,nd->n", points - place, normal), np.inf), normal
