"""A garment at one level of detail, from its cut to its drape."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse


@dataclass(frozen=True)
class Level:
    """A garment at one level of detail.

    Attributes:
        rest_shape: (n,3) vertices of the pattern, which define the rest lengths, metres.
        start: (n,3) where the simulation begins, on the body's rest pose.
        fitted: (n,3) where the garment fits the body closely, on its rest pose; pins hold it there.
        pin_weight: (n,) in [0,1].
        weights: (n,B) skinning weights that move the pins.
        faces: (F,3).
    """

    rest_shape: np.ndarray
    start: np.ndarray
    fitted: np.ndarray
    pin_weight: np.ndarray
    weights: np.ndarray
    faces: np.ndarray

    def resampled(self, matrix: sparse.csr_matrix, faces: np.ndarray) -> "Level":
        """Returns the level with other faces and vertices (m), combined from its own by a matrix (m,n)."""
        start, fitted, pin_weight = matrix @ self.start, matrix @ self.fitted, matrix @ self.pin_weight
        return Level(matrix @ self.rest_shape, start, fitted, pin_weight, matrix @ self.weights, faces)
