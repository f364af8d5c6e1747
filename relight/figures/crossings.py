"""Finds cloth that went through cloth: faces of garments that intersect deeply. Folds that graze do not count."""

import numpy as np
import warp as wp

from relight.figures.colliders import vectors
from relight.figures.surfaces import Surface, stacked

DEEP = 0.003  # metres by which two faces must reach through each other's planes, on both sides
APART = 0.03  # metres on the pattern: closer faces of one garment are neighbours


@wp.func
def through(a0: wp.vec3, a1: wp.vec3, a2: wp.vec3, b0: wp.vec3, b1: wp.vec3, b2: wp.vec3) -> float:
    """How far the triangle a reaches to both sides of the plane of b, metres; negative where it does not cross it."""
    n = wp.normalize(wp.cross(b1 - b0, b2 - b0))
    s0 = wp.dot(a0 - b0, n)
    s1 = wp.dot(a1 - b0, n)
    s2 = wp.dot(a2 - b0, n)
    return wp.min(wp.max(s0, wp.max(s1, s2)), -wp.min(s0, wp.min(s1, s2)))


@wp.kernel
def find_crossing(
    mesh: wp.uint64,
    x: wp.array(dtype=wp.vec3),
    corner: wp.array(dtype=int),
    middle: wp.array(dtype=wp.vec3),
    owner: wp.array(dtype=int),
    deep: float,
    apart: float,
    crosses: wp.array(dtype=int),
):
    f = wp.tid()
    a0 = x[corner[3 * f]]
    a1 = x[corner[3 * f + 1]]
    a2 = x[corner[3 * f + 2]]
    query = wp.mesh_query_aabb(mesh, wp.min(a0, wp.min(a1, a2)), wp.max(a0, wp.max(a1, a2)))
    g = wp.int32(0)
    while wp.mesh_query_aabb_next(query, g):
        if owner[f] != owner[g] or wp.length(middle[f] - middle[g]) > apart:
            b0 = x[corner[3 * g]]
            b1 = x[corner[3 * g + 1]]
            b2 = x[corner[3 * g + 2]]
            if through(a0, a1, a2, b0, b1, b2) > deep and through(b0, b1, b2, a0, a1, a2) > deep:
                if wp.intersect_tri_tri(a0, a1, a2, b0, b1, b2) != 0:
                    crosses[f] = 1


def crossing(sheets: list[Surface], patterns: list[np.ndarray]) -> list[float]:
    """The share of each garment's faces that went through cloth.

    Args:
        sheets: for each garment its vertices (n,3), metres, and faces (m,3).
        patterns: for each garment its vertices (n,3) on the pattern.

    Returns:
        For each garment the share of its faces that intersect, by more than DEEP, faces of another garment, or of its
        own that are more than APART away on the pattern.
    """
    x, faces = stacked(sheets)
    middle = np.concatenate([p[f].mean(1) for p, (_, f) in zip(patterns, sheets)])
    owner = np.repeat(np.arange(len(sheets)), [len(f) for _, f in sheets])
    points, corner = vectors(x), wp.array(faces.astype(np.int32).ravel(), dtype=int)
    mesh = wp.Mesh(points=points, indices=corner)
    crosses = wp.zeros(len(faces), dtype=int)
    whose = wp.array(owner.astype(np.int32), dtype=int)
    inputs = [mesh.id, points, corner, vectors(middle), whose, DEEP, APART, crosses]
    wp.launch(find_crossing, dim=len(faces), inputs=inputs)
    return [float(crosses.numpy()[owner == k].mean()) for k in range(len(sheets))]
