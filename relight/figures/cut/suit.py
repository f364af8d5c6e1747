"""The smooth suit around the body from which garments are cut, and the hull of the trunk that cloth spans."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from relight.figures.body import makehuman
from relight.figures.body.shape import Body
from relight.figures.surfaces import neighbours

BEARINGS = 96  # directions of the trunk's hull
SLICE = 0.02  # metres between the slices of the trunk's hull
MIN_OUTLINE = 6  # vertices of a slice; those of a tall person are further apart, and some slices have fewer
BLADES = 0.06  # metres below the base of the neck: highest point at which cloth spans the hollow of the spine
SEAT = (0.06, 0.25)  # cleft of the buttocks: largest distance from the middle, height above the crotch, metres
BUNCHED = 0.012  # metres that cloth is moved out to the hull, for which it is spread with full strength

Fields = dict[str, np.ndarray]  # attributes of vertices by name, see `suit_fields`


def _polyline_parameter(points: np.ndarray, line: list[np.ndarray]) -> np.ndarray:
    """Returns the parameter (n,) of the nearest point on a polyline: 1.5 is the middle of the second segment.

    Both ends are extended, so it may be below 0 and above the number of segments.
    """
    least_distance, parameter = np.full(len(points), np.inf), np.zeros(len(points))
    for k, (a, b) in enumerate(pairwise(line)):
        u = (points - a) @ (b - a) / ((b - a) @ (b - a))  # along the segment, from 0 to 1
        distance = np.linalg.norm(points - a - np.clip(u, 0, 1)[:, None] * (b - a), axis=1)
        is_nearer = distance < least_distance - 1e-9
        low, high = (-9 if k == 0 else 0), (9 if k == len(line) - 2 else 1)  # 9: hardly limited
        parameter = np.where(is_nearer, k + np.clip(u, low, high), parameter)
        least_distance = np.minimum(least_distance, distance)
    return parameter


def suit_fields(body: Body) -> Fields:
    """Returns attributes of the suit's vertices on the rest pose.

    These are x, y, z in metres; armL, armR (0 shoulder, 1 elbow, 2 wrist, -1 off the arm) and legL, legR (0 hip, 1
    knee, 2 ankle); arm_shareL, arm_shareR, the sum of the skinning weights of the arm's bones.
    """
    points, rig = body.tights, makehuman.rig()
    fields = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
    for side in "LR":
        arm_prefixes = ("upperarm", "lowerarm", "wrist")
        arm_bones = [i for i, b in enumerate(rig.bones) if b.endswith(f".{side}") and b.startswith(arm_prefixes)]
        share = rig.weights[makehuman.TIGHTS][:, arm_bones].sum(1)
        arm, leg = (
            _polyline_parameter(points, [body.joints[f"{bone}.{side}"] for bone in bones])
            for bones in (("upperarm01", "lowerarm01", "wrist"), ("upperleg01", "lowerleg01", "foot"))
        )
        fields[f"arm_share{side}"] = share
        fields[f"arm{side}"] = np.where(share > 0.05, arm, -1.0)
        fields[f"leg{side}"] = leg
    return fields


def arm_share(fields: Fields) -> np.ndarray:
    """Returns the sum of the skinning weights (n,) of the bones of the nearer arm."""
    return np.maximum(fields["arm_shareL"], fields["arm_shareR"])


@dataclass(frozen=True)
class Hull:
    """The convex hull of the trunk, slice by slice. Cloth spans hollows, such as the small of the back.

    Attributes:
        middle: z of the axis, metres.
        heights: (k,) of the slices, metres.
        radii: (k,BEARINGS) from the axis to the hull, metres.
    """

    middle: float
    heights: np.ndarray
    radii: np.ndarray

    def radius(self, points: np.ndarray) -> np.ndarray:
        """Returns the metres (n,) from the axis to the hull, at the height and in the direction of points (n,3)."""
        row = np.interp(points[:, 1], self.heights, np.arange(len(self.heights)))
        column = np.arctan2(points[:, 0], points[:, 2] - self.middle) % (2 * np.pi) * BEARINGS / (2 * np.pi)
        i, j = np.minimum(row.astype(int), len(self.heights) - 2), column.astype(int) % BEARINGS
        next_j = (j + 1) % BEARINGS
        a, b, radii = row - i, column - np.floor(column), self.radii  # bilinear
        low = radii[i, j] * (1 - b) + radii[i, next_j] * b
        high = radii[i + 1, j] * (1 - b) + radii[i + 1, next_j] * b
        return low * (1 - a) + high * a

    def straightened(self, low: float, share: float) -> "Hull":
        """Returns the hull of cloth that hangs straight over hollows along the height.

        Such hollows are between the shoulder blades and the seat, and between the chest and the belly.

        Args:
            low: height above which it hangs straight, metres.
            share: share of the hollows' depth that it spans, in [0,1].
        """
        radii, first = self.radii.copy(), int(np.searchsorted(self.heights, low))
        for lower in range(first, len(radii)):  # cloth is as far out as the line between any two slices
            for upper in range(lower + 2, len(radii)):
                between = self.heights[lower:upper] - self.heights[lower]
                t = (between / (self.heights[upper] - self.heights[lower]))[:, None]
                straight = self.radii[lower] * (1 - t) + self.radii[upper] * t
                radii[lower:upper] = np.maximum(radii[lower:upper], straight)
        return replace(self, radii=self.radii + share * (radii - self.radii))

    def expand(self, points: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Returns points (n,3) moved outward by a share (n,) of their distance to the hull, if they are inside it."""
        flat = points[:, [0, 2]] - [0.0, self.middle]
        r = np.maximum(np.linalg.norm(flat, axis=1), 1e-6)
        flat = flat * (1 + share * np.maximum(self.radius(points) - r, 0) / r)[:, None]
        return np.stack([flat[:, 0], points[:, 1], flat[:, 1] + self.middle], axis=1)


def trunk_hull(points: np.ndarray, fields: Fields, heights: dict[str, float]) -> Hull:
    """Measures the hull of the trunk from below the crotch to the shoulder blades.

    Args:
        points: (n,3) vertices of the suit, metres.
        fields: attributes (n,) of the vertices by name, see `suit_fields`.
        heights: see `Body.heights`.

    Returns:
        The hull; slices with too few vertices are interpolated between their neighbours.
    """
    trunk = points[arm_share(fields) < 0.05]
    slices = np.arange(heights["crotch"] - SLICE, heights["neck"] - BLADES + SLICE, SLICE)
    middle = float(np.median(trunk[np.abs(trunk[:, 1] - heights["waist"]) < 0.1, 2]))
    bearing = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    directions = np.stack([np.sin(bearing), np.cos(bearing)], axis=1)
    known, radii = [], []
    for height in slices:
        outline = trunk[np.abs(trunk[:, 1] - height) < 0.9 * SLICE][:, [0, 2]] - [0.0, middle]
        if len(outline) < MIN_OUTLINE:
            continue
        sides = ConvexHull(outline).equations  # unit normals (s,2) and offsets: n . x + offset = 0 on a side
        facing = directions @ sides[:, :2].T
        distance = np.where(facing > 1e-6, -sides[:, 2] / np.maximum(facing, 1e-6), np.inf)  # along each direction
        known.append(height)
        radii.append(np.min(distance, axis=1))
    columns = [np.interp(slices, known, radius) for radius in np.transpose(radii)]  # one for each direction
    return Hull(middle, slices, np.stack(columns, axis=1))


def expand_evenly(hull: Hull, points: np.ndarray, faces: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Moves points out to a hull and spreads those from the cleft between the buttocks over the seat.

    Without this, the cloth that lined the cleft would be bunched on a narrow strip, and crumple there.

    Args:
        hull: convex hull of the trunk.
        points: (n,3) metres.
        faces: (F,3).
        share: (n,) of the distance to the hull that points inside it are moved.

    Returns:
        (n,3) metres.
    """
    expanded = hull.expand(points, share)
    average = neighbours(faces, len(points))
    moved = np.linalg.norm(expanded - points, axis=1)  # metres
    for _ in range(3):
        moved = np.maximum(moved, 0.7 * (average @ moved))
    seat_width, seat_height = SEAT
    on_seat = (np.abs(points[:, 0]) < seat_width) & (points[:, 1] < hull.heights[0] + seat_height)
    on_seat &= points[:, 2] < hull.middle
    spread = (on_seat * np.clip(moved / BUNCHED, 0, 1))[:, None] * [1.0, 0.0, 1.0]  # strength of the smoothing, level
    for _ in range(12):
        expanded = hull.expand(expanded + 0.7 * spread * (average @ expanded - expanded), share)
    return expanded
