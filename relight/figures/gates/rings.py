"""Tests whether limbs are inside their cloth: how often rings around a sleeve or trouser leg wind around the bone."""

import numpy as np

from relight.figures.body.kinematics import unit
from relight.figures.body.motion import Motion
from relight.figures.cut.patterns import Pattern

EXTENSION = 10.0  # extension of a limb's line at both ends, beyond any ring, metres
LEVELS = np.arange(0.05, 2.0, 0.05)  # where rings lie along an arm (0 shoulder, 1 elbow, 2 wrist) or leg
LIMBS = {  # kind of garment: the field along its limbs, and the bones at whose heads that is 0, 1, 2
    "top": ("arm", ("upperarm01", "lowerarm01", "wrist")),
    "trousers": ("leg", ("upperleg01", "lowerleg01", "foot")),
}


def _contour(values: np.ndarray, faces: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """Finds the contour line of a field (n,), linear on each face, which it crosses in one straight piece.

    Returns:
        edges: (S,2,2) vertices of the two edges on which each of the S pieces begins and ends. Pieces run with the
            higher values to their right, seen from the side on which faces turn counter-clockwise.
        share: (S,2) position on these edges, 0 at the first vertex and 1 at the second.
        closed: whether every piece begins where another one ends.
    """
    above = values[faces] > level
    crossed = faces[above.any(1) & ~above.all(1)]
    above = values[crossed] > level
    next_above = np.roll(above, -1, axis=1)  # of the next corner of the face
    begin_corner, end_corner = (above & ~next_above).argmax(1), (~above & next_above).argmax(1)  # where sides cross it
    row = np.arange(len(crossed))
    sides = [np.stack([crossed[row, k], crossed[row, (k + 1) % 3]], axis=1) for k in (begin_corner, end_corner)]
    edges = np.sort(np.stack(sides, axis=1), axis=2)
    first, second = values[edges[..., 0]], values[edges[..., 1]]
    # An edge as one number, so that the edges on which pieces begin and end can be compared.
    begin_edges, end_edges = (np.sort(edges[:, k, 0] * len(values) + edges[:, k, 1]) for k in (0, 1))
    return edges, (level - first) / (second - first), bool(np.array_equal(begin_edges, end_edges))


def winding(ring: np.ndarray, line: np.ndarray) -> int:
    """Returns how often a closed ring winds around a line, counter-clockwise when seen from the line's end.

    This is their linking number. No deformation changes it unless one passes through the other.

    Args:
        ring: (S,2,3) start and end of its pieces, in any order; several closed rings count together.
        line: (m,3) points of a polyline, whose ends are extended straight on by EXTENSION.

    Returns:
        The signed number of times that the line crosses the fan of triangles from the ring's mean to its pieces.
    """
    before, after = line[0] + EXTENSION * unit(line[0] - line[1]), line[-1] + EXTENSION * unit(line[-1] - line[-2])
    points = np.concatenate([[before], line, [after]])
    # Each segment of the line is intersected with each triangle of the fan: one axis for segments, one for triangles.
    start, segment = points[:-1, None], np.diff(points, axis=0)[:, None]
    centre = ring.mean((0, 1))
    side_p, side_q = ring[:, 0] - centre, ring[:, 1] - centre
    normal = np.cross(side_p, side_q)
    facing = (segment * normal).sum(-1)
    to_centre = centre - start
    with np.errstate(divide="ignore", invalid="ignore"):  # segments parallel to a triangle have no t, and are outside
        t = (to_centre * normal).sum(-1) / facing  # position of the intersection along the segment
        turned = np.cross(segment, to_centre)
        u, v = -(turned * side_q).sum(-1) / facing, (turned * side_p).sum(-1) / facing  # and in the triangle's sides
        inside = (t >= 0) & (t < 1) & (u >= 0) & (v >= 0) & (u + v < 1)
    return int((np.sign(facing) * inside).sum())


def lost_rings(pattern: Pattern, x: np.ndarray, motion: Motion) -> dict[str, tuple[int, int]]:
    """Counts the rings around sleeves or trouser legs that do not wind around the bone once.

    Rings are closed contour lines of the garment's field along the limb, at LEVELS. Only rings that wind around the
    bone once on the rest pose are tested: those on a sleeve or leg, not on the trunk.

    Args:
        pattern: whose fields run along arms (tops) or legs (trousers).
        x: (n,3) the draped finest vertices, metres.
        motion: how the body moves from its rest pose into the pose.

    Returns:
        For each limb with rings, such as "left arm": the number that do not wind once, and the number of all.
    """
    if pattern.garment.kind not in LIMBS:
        return {}
    field, bones = LIMBS[pattern.garment.kind]
    level, counts = pattern.levels[-1], {}
    for side, word in (("L", "left"), ("R", "right")):
        names = [f"{bone}.{side}" for bone in bones]
        rest_line = np.stack([motion.body.joints[name] for name in names])
        posed_line = np.stack([motion.joint(name) for name in names])
        on_side = (pattern.fields["x"] > 0) == (side == "L")
        on_limb = pattern.fields[f"arm_share{side}"] > 0.5 if field == "arm" else on_side
        faces = level.faces[on_limb[level.faces].all(1)]
        winds_once = []  # for each ring, as draped
        for ring_level in LEVELS:
            edge, share, closed = _contour(pattern.fields[f"{field}{side}"], faces, ring_level)
            if not closed or len(edge) == 0:
                continue
            near, far, share = edge[..., 0], edge[..., 1], share[..., None]
            rest_ring, draped_ring = (points[near] * (1 - share) + points[far] * share for points in (level.fitted, x))
            if winding(rest_ring, rest_line) == 1:
                winds_once.append(winding(draped_ring, posed_line) == 1)
        if winds_once:
            counts[f"{word} {field}"] = (winds_once.count(False), len(winds_once))
    return counts
