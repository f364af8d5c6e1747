"""The camera of the maps: orthographic, or perspective from a distance."""

from dataclasses import dataclass

import numpy as np

from relight.files import UserError
from relight.transport.view import Pose, turned


@dataclass(frozen=True)
class Camera:
    """Looks along -z at the square [-1, 1]^2 of the plane z = 0, from the camera plane z = `distance`.

    Orthographic rays start on the camera plane; perspective rays start at (0, 0, distance) and meet z = 0 where the
    orthographic rays of the same pixels do, so both frame a figure at the origin alike. `size` is in pixels. All this
    is in the camera's frame, which is the mesh's own unless `pose` says where the mesh is.
    """

    size: int
    distance: float = 2.0
    perspective: bool = False
    pose: Pose | None = None

    def __post_init__(self):
        if self.size < 1:
            raise UserError(f"image size {self.size}: it must be at least 1 pixel")
        if not self.distance > 0:
            raise UserError(f"camera distance {self.distance}: it must be positive")

    def rays(self, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Rays (N, 6) float64 in the mesh's frame, origin and direction, through continuous pixel coordinates (N,).

        (0, 0) is the corner of the top left pixel and (.5, .5) its centre. Every direction has z = -1 in the camera's
        frame, so that the ray's parameter is the depth.
        """
        x, y = 2 * column / self.size - 1, 1 - 2 * row / self.size
        rays = np.zeros((len(x), 6))
        rays[:, 2], rays[:, 5] = self.distance, -1
        if self.perspective:
            rays[:, 3], rays[:, 4] = x / self.distance, y / self.distance
        else:
            rays[:, 0], rays[:, 1] = x, y
        if self.pose is not None:
            rays[:, :3] = self.pose.to_mesh(rays[:, :3])
            rays[:, 3:] = turned(self.pose.rotation.T, rays[:, 3:]) / self.pose.scale
        return rays

    def toward(self, points: np.ndarray) -> np.ndarray:
        """Directions (N, 3) in the mesh's frame from its `points` to the camera, not normalised."""
        if self.perspective:
            eye = np.array([[0, 0, self.distance]])
            return (eye if self.pose is None else self.pose.to_mesh(eye)) - points
        axis = np.array([0.0, 0.0, 1.0])
        return np.broadcast_to(axis if self.pose is None else axis @ self.pose.rotation, points.shape)

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Depths (N,) of the mesh's `points`: along -z from the camera plane, in units of the camera's frame."""
        return self.distance - (points if self.pose is None else self.pose.to_camera(points))[:, 2]
