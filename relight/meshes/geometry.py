"""Geometry of triangle meshes: normals, areas, connected parts."""

import numpy as np

from relight.meshes.mesh import Mesh


def vertex_normals(mesh: Mesh) -> np.ndarray:
    """Returns the normals of vertices: face normals weighted by the angle at the vertex.

    With these weights the normals do not depend on how the surface is cut into triangles (Thürmer & Wüthrich 1998).
    Faces without area are ignored; a vertex without any other face gets (0,0,1), so no normal is zero or NaN.

    Returns:
        (V,3) float32 unit vectors.
    """
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    edges = np.roll(corners, -1, axis=1) - corners  # edge k runs from corner k to corner k+1
    normal = normalised(np.cross(edges[:, 0], edges[:, 1]))
    directions = normalised(edges)
    cosine = -np.einsum("fkc,fkc->fk", directions, np.roll(directions, 1, axis=1))
    angle = np.arccos(np.clip(cosine, -1, 1))
    weighted = (angle[..., None] * normal[:, None]).reshape(-1, 3)
    index = mesh.faces.reshape(-1)
    total = np.stack([np.bincount(index, weighted[:, c], len(mesh.vertices)) for c in range(3)], axis=-1)
    normals = normalised(total)
    normals[~normals.any(axis=-1)] = (0, 0, 1)
    return normals.astype(np.float32)


def normalised(vectors: np.ndarray) -> np.ndarray:
    """Scales vectors (...,3) to length one; those that are too short or not finite become zero."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        good = (length > 1e-30) & np.isfinite(length)
        return np.where(good, vectors, 0) / np.where(good, length, 1)


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns the areas (F,) float64 of faces (F,3), in square units of the vertices (V,3)."""
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=-1) / 2


def edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the edges of a mesh.

    Args:
        faces: (F,3).

    Returns:
        The two vertices (E,2) of each edge, ascending; the index (F,3) of the edge at each side 01, 12, 20 of a face;
        the number of faces (E,) at each edge: 1 on the border, 2 inside.
    """
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1).astype(np.int64)
    n = int(faces.max(initial=0)) + 1
    key = sides[:, 0] * n + sides[:, 1]  # one number for an edge is faster than rows of two
    unique, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    return np.stack([unique // n, unique % n], axis=1), inverse.reshape(3, -1).T, count


def connected_parts(faces: np.ndarray, vertices: int) -> np.ndarray:
    """Numbers the connected parts of a mesh from 0.

    Args:
        faces: (F,3); those that share a vertex are connected.
        vertices: their number.

    Returns:
        (F,) the part of each face.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=(vertices, vertices))
    _, label = connected_components(graph.tocsr(), directed=False)
    return np.unique(label[faces[:, 0]], return_inverse=True)[1]


def solidity(vertices: np.ndarray, faces: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Returns the signed volume of each part over that of the ball with the same area.

    It is 1 for a sphere, -1 for one turned inside out, near 0 for flat sheets. The holes of open parts are closed by
    cones to the part's centre.

    Args:
        vertices: (V,3).
        faces: (F,3).
        part: (F,) of each face.

    Returns:
        (P,) float64.
    """
    corners = vertices[faces].astype(np.float64)
    area = face_areas(vertices, faces)
    count = part.max() + 1
    total = np.maximum(np.bincount(part, area, count), 1e-300)
    centroid = corners.mean(axis=1)
    centre = np.stack([np.bincount(part, area * centroid[:, c], count) for c in range(3)], axis=-1) / total[:, None]
    a, b, c = (corners[:, k] - centre[part] for k in range(3))
    volume = np.bincount(part, np.einsum("fc,fc->f", a, np.cross(b, c)) / 6, count)
    return volume / (total**1.5 / (6 * np.sqrt(np.pi)))
