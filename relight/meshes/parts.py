"""Areas, volumes and connected parts of a mesh."""

import numpy as np


def areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area of each face (F,) float64, in square units of the vertices."""
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=-1) / 2


def parts(faces: np.ndarray, vertices: int) -> np.ndarray:
    """The connected part that each face belongs to (F,), numbered from 0; faces that share a vertex are connected."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=(vertices, vertices))
    _, label = connected_components(graph.tocsr(), directed=False)
    return np.unique(label[faces[:, 0]], return_inverse=True)[1]


def solidity(vertices: np.ndarray, faces: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Signed volume of each part about its own centre, as a share of the ball's with the same area (P,).

    1 for a sphere, -1 for one turned inside out, near 0 for flat sheets; open parts count with their volume as if
    their holes were closed by cones to the centre.
    """
    corners = vertices[faces].astype(np.float64)
    area = areas(vertices, faces)
    count = part.max() + 1
    total = np.maximum(np.bincount(part, area, count), 1e-300)
    centroid = corners.mean(axis=1)
    centre = np.stack([np.bincount(part, area * centroid[:, c], count) for c in range(3)], axis=-1) / total[:, None]
    a, b, c = (corners[:, k] - centre[part] for k in range(3))
    volume = np.bincount(part, np.einsum("fc,fc->f", a, np.cross(b, c)) / 6, count)
    return volume / (total**1.5 / (6 * np.sqrt(np.pi)))
