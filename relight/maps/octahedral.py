"""The octahedral map of unit vectors to a square (Cigolle et al. 2014)."""

import numpy as np


def octahedral(normals: np.ndarray) -> np.ndarray:
    """Returns the octahedral coordinates (...,2) in [-1,1] of unit vectors (...,3); +z is at the centre."""
    flat = normals / np.maximum(np.abs(normals).sum(-1, keepdims=True), 1e-9)
    return np.where(flat[..., 2:] < 0, fold(flat[..., :2]), flat[..., :2])


def fold(square: np.ndarray) -> np.ndarray:
    """Reflects points (...,2) of the square about the nearest edge of the diamond |x| + |y| = 1, where z = 0.

    So the corners of the square, outside the diamond, hold the hemisphere z < 0.
    """
    return (1 - np.abs(square[..., ::-1])) * np.where(square < 0, np.float32(-1), np.float32(1))
