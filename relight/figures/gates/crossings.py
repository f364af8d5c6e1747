"""Finds cloth that passed through cloth: faces of garments that intersect deeply. Folds that graze do not count."""

import numpy as np
import warp as wp

from relight.figures.drape.colliders import vec3_array
from relight.figures.drape.kernels import find_intersections
from relight.figures.surfaces import Surface, stacked

MIN_DEPTH = 0.003  # how deep two faces must reach through each other's planes, on both sides, metres
MIN_REST_DISTANCE = 0.03  # metres on the pattern: closer faces of one garment are neighbours


def crossing(sheets: list[Surface], rest_shapes: list[np.ndarray]) -> list[float]:
    """Measures which share of each garment's faces passed through cloth.

    Args:
        sheets: for each garment its vertices (n,3), metres, and faces (m,3).
        rest_shapes: for each garment its vertices (n,3) on the pattern, metres.

    Returns:
        For each garment the share of its faces that intersect, by more than MIN_DEPTH, faces of another garment, or
        its own that are more than MIN_REST_DISTANCE away on the pattern.
    """
    x, faces = stacked(sheets)
    centres = np.concatenate([rest[f].mean(1) for rest, (_, f) in zip(rest_shapes, sheets)])
    garment = np.repeat(np.arange(len(sheets)), [len(f) for _, f in sheets])
    points = vec3_array(x)
    indices: wp.array = wp.array(faces.astype(np.int32).ravel(), dtype=int)
    mesh = wp.Mesh(points=points, indices=indices)
    intersects = wp.zeros(len(faces), dtype=int)
    garments: wp.array = wp.array(garment.astype(np.int32), dtype=int)
    limits = [MIN_DEPTH, MIN_REST_DISTANCE]
    inputs = [mesh.id, points, indices, vec3_array(centres), garments, *limits, intersects]
    wp.launch(find_intersections, dim=len(faces), inputs=inputs)
    return [float(intersects.numpy()[garment == k].mean()) for k in range(len(sheets))]
