"""Finds cloth that went through cloth: faces of garments that intersect deeply. Folds that graze do not count."""

import numpy as np
import warp as wp

from relight.figures.colliders import vectors
from relight.figures.kernels import find_crossing
from relight.figures.surfaces import Surface, stacked

DEEP = 0.003  # metres by which two faces must reach through each other's planes, on both sides
APART = 0.03  # metres on the pattern: closer faces of one garment are neighbours


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
    points = vectors(x)
    corner: wp.array = wp.array(faces.astype(np.int32).ravel(), dtype=int)
    mesh = wp.Mesh(points=points, indices=corner)
    crosses = wp.zeros(len(faces), dtype=int)
    whose: wp.array = wp.array(owner.astype(np.int32), dtype=int)
    inputs = [mesh.id, points, corner, vectors(middle), whose, DEEP, APART, crosses]
    wp.launch(find_crossing, dim=len(faces), inputs=inputs)
    return [float(crosses.numpy()[owner == k].mean()) for k in range(len(sheets))]
