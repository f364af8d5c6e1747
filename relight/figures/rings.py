"""Tests whether limbs are inside their cloth: how often rings around a sleeve or trouser leg wind around the bone."""

import numpy as np

from relight.figures.pose.motion import Motion
from relight.figures.tailor.patterns import Pattern

EXTENSION = 10.0  # extension of a limb's line at both ends, beyond any ring, metres
LEVELS = np.arange(0.05, 2.0, 0.05)  # where rings lie along an arm (0 shoulder, 1 elbow, 2 wrist) or leg
LIMBS = {  # kind of garment: the field along its limbs, and the bones at whose heads that is 0, 1, 2
    "top": ("arm", ("upperarm01", "lowerarm01", "wrist")),
    "trousers": ("leg", ("upperleg01", "lowerleg01", "foot")),
}


def contour(values: np.ndarray, faces: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """Finds the contour line of a field on a surface; it crosses each face in one straight piece.

    Args:
        values: (n,) the field at the vertices, linear on each face.
        faces: (F,3) of one orientation.
        level: the value.

    Returns:
        edges: (S,2,2) vertices of the two edges on which each of the S pieces begins and ends. Pieces run with the
            higher values to their right, seen from the side on which faces turn counter-clockwise.
        share: (S,2) position on these edges, 0 at the first vertex and 1 at the second.
        closed: whether every piece begins where another one ends.
    """
    above = values[faces] > level
    crossed = faces[above.any(1) & ~above.all(1)]
    above = values[crossed] > level
    row = np.arange(len(crossed))
    following = np.roll(above, -1, axis=1)
    ends = []
    for k in ((above & ~following).argmax(1), (~above & following).argmax(1)):
        ends.append(np.sort(np.stack([crossed[row, k], crossed[row, (k + 1) % 3]], axis=1), axis=1))
    edge = np.stack(ends, axis=1)
    a, b = values[edge[..., 0]], values[edge[..., 1]]
    size = len(values)
    begins, stops = (np.sort(edge[:, k, 0] * size + edge[:, k, 1]) for k in (0, 1))
    return edge, (level - a) / (b - a), bool(np.array_equal(begins, stops))


def winding(ring: np.ndarray, line: np.ndarray) -> int:
    """Returns how often a closed ring winds around a line, counter-clockwise when seen from the line's end.

    This is their linking number. No deformation changes it unless one passes through the other.

    Args:
        ring: (S,2,3) start and end of its pieces, in any order; several closed rings count together.
        line: (m,3) points of a polyline, whose ends are extended straight on by EXTENSION.

    Returns:
        The signed number of times that the line crosses the fan of triangles from the ring's mean to its pieces.
    """
    first, last = line[0] - line[1], line[-1] - line[-2]
    before, after = (
        end + EXTENSION * direction / np.linalg.norm(direction)
        for end, direction in ((line[0], first), (line[-1], last))
    )
    points = np.concatenate([[before], line, [after]])
    start, along = points[:-1, None], np.diff(points, axis=0)[:, None]
    centre = ring.mean((0, 1))
    p, q = ring[:, 0] - centre, ring[:, 1] - centre  # each piece, with the centre, is a triangle
    normal = np.cross(p, q)
    facing = (along * normal).sum(-1)
    off = centre - start
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (off * normal).sum(-1) / facing
        turned = np.cross(along, off)
        u, v = -(turned * q).sum(-1) / facing, (turned * p).sum(-1) / facing
        inside = (t >= 0) & (t < 1) & (u >= 0) & (v >= 0) & (u + v < 1)
    return int((np.sign(facing) * inside).sum())


def lost_rings(pattern: Pattern, x: np.ndarray, motion: Motion) -> dict[str, tuple[int, int]]:
    """Counts the rings around sleeves or trouser legs that do not wind around the bone once.

    Rings are closed contour lines of the garment's field along the limb, at LEVELS. Only rings that wind around the
    bone once on the rest pose are tested: those on a sleeve or leg, not on the trunk.

    Args:
        pattern: whose fields run along arms (tops) or legs (trousers).
        x: (n,3) the draped finest vertices, metres.
        motion: of the body into the pose.

    Returns:
        For each limb with rings, the number that do not wind once, and the number of all.
    """
    field, bones = LIMBS.get(pattern.garment.kind, ("", ()))
    level, out = pattern.levels[-1], {}
    for side, word in (("L", "left"), ("R", "right")) if bones else ():
        names = [f"{bone}.{side}" for bone in bones]
        rest = np.stack([motion.body.joints[name] for name in names])
        posed = np.stack([motion.joint(name) for name in names])
        on = pattern.fields[f"arm_share{side}"] > 0.5 if field == "arm" else (pattern.fields["x"] > 0) == (side == "L")
        faces = level.faces[on[level.faces].all(1)]
        wound = []
        for at in LEVELS:
            edge, share, closed = contour(pattern.fields[f"{field}{side}"], faces, at)
            if not closed or len(edge) == 0:
                continue
            near, far, share = edge[..., 0], edge[..., 1], share[..., None]
            before, after = (p[near] * (1 - share) + p[far] * share for p in (level.fitted, x))
            if winding(before, rest) == 1:
                wound.append(winding(after, posed) == 1)
        if wound:
            out[f"{word} {field}"] = (wound.count(False), len(wound))
    return out
