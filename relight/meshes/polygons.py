"""Cuts polygons into triangles: fans where they stay inside, else by clipping ears."""

from pathlib import Path

import numpy as np

from relight.core.errors import UserError

MAX_CORNERS = 1000  # of a polygon that is not convex; clipping ears takes the square of it
BLOCK = 1 << 13  # polygons that are tested at a time
FLAT = 1e-9  # share of a polygon's area that rounding may turn over


def triangulate(
    path: Path, counts: np.ndarray, index: np.ndarray, vertices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cuts polygons, whose corners are in one flat list, into triangles.

    Args:
        path: for error messages.
        counts: (P,) of the polygons' corners; polygons of fewer than three give no triangle.
        index: (N,) the vertex of each corner.
        vertices: (V,3).

    Returns:
        Positions (F,3) of the triangles' corners in the flat list, and the polygon (F,) of each triangle.

    Raises:
        UserError: if a polygon that is not convex has over MAX_CORNERS corners.
    """
    position, polygon = _fan(counts)
    if (counts > 3).any() and index.min() >= 0 and index.max() < len(vertices):
        for bad in _turned_over(np.asarray(counts, np.int64), index, vertices):
            if counts[bad] > MAX_CORNERS:
                raise UserError(f"{path}: a face that is not convex has {counts[bad]} corners: cut it into triangles")
            first = np.searchsorted(polygon, bad)
            start = position[first, 0]
            corners = vertices[index[start : start + counts[bad]]]
            position[first : first + counts[bad] - 2] = start + _clip_ears(corners)
    return position, polygon


def _fan(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cuts polygons into fans from their first corners: positions (F,3) in the flat list, and polygons (F,).

    >>> _fan(np.array([3, 4]))[0].tolist()
    [[0, 1, 2], [3, 4, 5], [3, 5, 6]]
    """
    counts = np.asarray(counts, np.int64)
    pieces = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), pieces)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first = (np.cumsum(counts) - counts)[polygon]
    return np.stack([first, first + step + 1, first + step + 2], axis=-1), polygon


def _turned_over(counts: np.ndarray, index: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Returns the polygons, ascending, whose fans leave them: triangles of such a fan face both ways."""
    start, bad = np.cumsum(counts) - counts, [np.zeros(0, np.int64)]
    axes = [np.ascontiguousarray(vertices[:, axis]) for axis in range(3)]  # four times as fast as rows of three
    for size in np.unique(counts[counts > 3]):
        alike = np.flatnonzero(counts == size)
        for block in np.split(alike, range(BLOCK, len(alike), BLOCK)):
            corner = index[start[block] + np.arange(size)[:, None]]
            with np.errstate(invalid="ignore", over="ignore"):
                x, y, z = (edge[1:] - edge[0] for edge in (axis.take(corner) for axis in axes))
                normal = (  # of each triangle of the fan, twice its area long
                    y[:-1] * z[1:] - z[:-1] * y[1:],
                    z[:-1] * x[1:] - x[:-1] * z[1:],
                    x[:-1] * y[1:] - y[:-1] * x[1:],
                )
                total = [part.sum(0) for part in normal]
                along = sum(part * whole for part, whole in zip(normal, total))
                is_turned = along < -FLAT * sum(whole * whole for whole in total)
            bad.append(block[is_turned.any(0)])
    return np.unique(np.concatenate(bad))


def _clip_ears(corners: np.ndarray) -> np.ndarray:
    """Cuts a simple polygon into triangles that stay inside (Meisters, "Polygons have ears", 1975).

    An ear is a corner whose triangle holds no other corner. The best-shaped one is cut off first. The triangles
    (N-2,3) are wound as the polygon (N,3), which need not be quite flat.
    """
    flat = _projected(corners)
    before, after = np.roll(np.arange(len(flat)), 1), np.roll(np.arange(len(flat)), -1)
    turn = _cross(flat - flat[before], flat[after] - flat)
    tiny = FLAT * np.abs(turn).max()

    def score(corner: int) -> float:
        """Returns the shape of an ear, above 0; -1 for a straight corner, -2 for one that is no ear."""
        triangle = flat[[before[corner], corner, after[corner]]]
        if turn[corner] <= tiny:
            return -1 if turn[corner] >= -tiny else -2
        inner = flat[turn < -tiny]
        sides = np.roll(triangle, -1, axis=0) - triangle
        within = (_cross(sides, inner[:, None] - triangle) >= -tiny).all(-1)
        within &= (inner[:, None] != triangle).any(-1).all(-1)  # others at the place of a corner are no obstacle
        return -2 if within.any() else float(turn[corner] / (sides**2).sum())  # largest for equal sides

    scores = np.array([score(corner) for corner in range(len(flat))])
    triangles = []
    for _ in range(len(flat) - 2):
        corner = int(scores.argmax())  # a polygon that crosses itself may have no ear
        start, end = before[corner], after[corner]
        triangles.append((start, corner, end))
        after[start], before[end] = end, start
        turn[corner], scores[corner] = 0, -3  # below all others: it is gone
        for other in (start, end):
            turn[other] = _cross(flat[other] - flat[before[other]], flat[after[other]] - flat[other])
        scores[start], scores[end] = score(start), score(end)
    return np.array(triangles)


def _projected(corners: np.ndarray) -> np.ndarray:
    """Returns a polygon (N,3) in the coordinate plane (N,2) that it is most parallel to, counter-clockwise."""
    centred = corners - corners.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    drop = int(np.abs(normal).argmax())
    flat = centred[:, [(drop + 1) % 3, (drop + 2) % 3]]
    return flat if normal[drop] > 0 else flat * [1, -1]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the cross products (...) of vectors (...,2) of a plane: positive where b is counter-clockwise of a."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
