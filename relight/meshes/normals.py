"""Vertex normals."""

import numpy as np

from relight.meshes.mesh import Mesh


def face_normals(mesh: Mesh) -> np.ndarray:
    """Unit normals of the faces (F,3) float32, counter-clockwise outward; zero where a face has no area."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return unit(np.cross(b - a, c - a)).astype(np.float32)


def vertex_normals(mesh: Mesh) -> np.ndarray:
    """Unit normals of the vertices (V,3) float32: face normals weighted by the corner's angle.

    Angle weights make the normal independent of how the surface is cut into triangles (Thürmer & Wüthrich 1998).
    Faces without area have no say; a vertex without any other face gets (0,0,1), so that no normal is ever zero or NaN.
    """
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    edges = np.roll(corners, -1, axis=1) - corners  # edge k runs from corner k to corner k+1
    normal = unit(np.cross(edges[:, 0], edges[:, 1]))
    directions = unit(edges)
    cosine = -np.einsum("fkc,fkc->fk", directions, np.roll(directions, 1, axis=1))
    angle = np.arccos(np.clip(cosine, -1, 1))
    weighted = (angle[..., None] * normal[:, None]).reshape(-1, 3)
    index = mesh.faces.reshape(-1)
    total = np.stack([np.bincount(index, weighted[:, c], len(mesh.vertices)) for c in range(3)], axis=-1)
    normals = unit(total)
    normals[~normals.any(axis=-1)] = (0, 0, 1)
    return normals.astype(np.float32)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (...,3) at length one; those too short to have a direction, and non-finite ones, become zero."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        good = (length > 1e-30) & np.isfinite(length)
        return np.where(good, vectors, 0) / np.where(good, length, 1)
