"""The camera of the maps, orthographic or perspective."""

from dataclasses import dataclass

import numpy as np

from relight.transport.view import Pose, rotate_vectors


@dataclass(frozen=True)
class Camera:
    """A camera at z = `distance` that looks along -z at the square [-1,1]^2 of the plane z = 0.

    Orthographic rays start on the plane z = `distance`; perspective rays start at (0,0,distance) and meet the plane
    z = 0 where the orthographic rays of the same pixels do, so both show a figure at the origin at the same size.

    Attributes:
        size: side of the square image, pixels.
        distance: distance of the camera plane from the origin, in units of the camera's frame.
        perspective: whether the camera is perspective; otherwise it is orthographic.
        pose: pose of the mesh in the camera's frame; None if the mesh's frame is the camera's.
    """

    size: int
    distance: float = 2.0
    perspective: bool = False
    pose: Pose | None = None

    def rays(self, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Returns the rays through points of the image.

        Args:
            column: (N,) in pixels; (0,0) is the corner of the top left pixel and (.5,.5) its centre.
            row: (N,) in pixels.

        Returns:
            (N,6) float64 origins and directions in the mesh's frame. In the camera's frame, all directions have
            z = -1, so a ray's parameter is the depth.
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
            rays[:, 3:] = rotate_vectors(self.pose.rotation.T, rays[:, 3:]) / self.pose.scale
        return rays

    def toward(self, points: np.ndarray) -> np.ndarray:
        """Returns the directions (N,3), not normalised, from points (N,3) to the camera, all in the mesh's frame."""
        if self.perspective:
            eye = np.array([[0, 0, self.distance]])
            return (eye if self.pose is None else self.pose.to_mesh(eye)) - points
        axis = np.array([0.0, 0.0, 1.0])
        return np.broadcast_to(axis if self.pose is None else axis @ self.pose.rotation, points.shape)

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Returns the depths (N,) of points (N,3) of the mesh's frame: along -z, in units of the camera's frame."""
        return self.distance - (points if self.pose is None else self.pose.to_camera(points))[:, 2]
