"""The calibrated camera of a capture."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Pinhole:
    """A calibrated camera with the interface of `relight.transport.camera.Camera`.

    Attributes:
        size: (height, width) of the image in pixels.
        focal: (2,) along x and y, pixels.
        centre: (2,) x and y of the principal point, pixels from the corner of the top left pixel.
        rotation: (3,3) from the world's axes to the camera's (+x right, +y up, +z toward the camera).
        eye: (3,) in the world.
    """

    size: tuple[int, int]
    focal: np.ndarray
    centre: np.ndarray
    rotation: np.ndarray
    eye: np.ndarray

    def rays(self, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Returns the rays through points of the image, in the world.

        Args:
            column, row: (N,) pixels from the corner of the top left pixel.

        Returns:
            (N,6) float64: the eye, and a direction along which the camera's z falls by 1.
        """
        x, y = (column - self.centre[0]) / self.focal[0], (self.centre[1] - row) / self.focal[1]
        toward = np.stack([x, y, np.full_like(x, -1.0)], -1) @ self.rotation
        return np.concatenate([np.broadcast_to(self.eye, toward.shape), toward], -1)

    def toward(self, points: np.ndarray) -> np.ndarray:
        """Returns the directions (N,3), not normalised, from points (N,3) of the world to the camera."""
        return self.eye - points

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Returns the depths (N,) of points (N,3) of the world, along the optical axis."""
        return (self.eye - points) @ self.rotation[2]

    def project(self, points: np.ndarray) -> np.ndarray:
        """Returns x and y (N,2) in the image of points (N,3) of the world; nan behind the camera."""
        x, y, z = (self.rotation @ (points - self.eye).T).astype(np.float64)
        z = np.where(z < 0, -z, np.nan)
        return np.stack([self.centre[0] + self.focal[0] * x / z, self.centre[1] - self.focal[1] * y / z], -1)
