"""Polygons to triangles."""

import numpy as np


def fan(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangle fans over polygons whose corners lie one after another in a flat list.

    counts (P,) corners of each polygon. Returns the positions of the triangles' corners in the flat list (F,3) and
    the polygon that each triangle comes from (F,); polygons of fewer than three corners give no triangle.
    """
    counts = np.asarray(counts, np.int64)
    start = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else counts
    if len(counts) and (counts == 3).all():
        return start[:, None] + np.arange(3), np.arange(len(counts))
    pieces = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), pieces)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first = start[polygon]
    return np.stack([first, first + step + 1, first + step + 2], axis=-1), polygon
