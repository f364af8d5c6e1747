"""Builds a garment's pattern for a body.

A garment is cut from a smooth suit around the body (MakeHuman's tights), moved outward by its ease, lengthened,
extended by a drop (skirts, coat tails), and refined by Loop subdivision.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import ConvexHull

from relight.figures.body import makehuman
from relight.figures.body.person import Body
from relight.figures.cloth.drape import Level
from relight.figures.surfaces import (
    border_loops,
    clip,
    compacted,
    extruded,
    loop,
    neighbours,
    normals,
    rim,
    smoothed,
    split,
)
from relight.figures.tailor.garments import ARM_AT, LEG_AT, TORSO_AT, Garment

PIN_OFFSET = 0.004  # metres from the suit to pinned cuffs, waistbands and necklines
HEM = 0.06  # height above the crotch where the length of a drop with a seam at the waist begins, metres
LEG = 0.82  # metres from hip to ankle, for which the lengths of drops are given
ROW = 0.028  # metres between the rows of a drop
GATHERED = 0.06  # metres from the top of a drop to the full depth of its gathers
HANGING_FLARE = 0.35  # share of its flare that a drop keeps as it hangs
HIP_CLEARANCE = 0.014  # metres between a drop and the hull of the hips
BEARINGS = 96  # directions of the trunk's hull
SLICE = 0.02  # metres between the slices of the trunk's hull
MIN_OUTLINE = 6  # vertices of a slice; those of a tall person are further apart, and some slices have fewer
BLADES = 0.06  # metres below the base of the neck: highest point at which cloth spans the hollow of the spine
FADE = 0.12  # metres below that over which this begins
SEAT = (0.06, 0.25)  # cleft of the buttocks: largest distance from the middle, height above the crotch, metres
BUNCHED = 0.012  # metres that cloth is moved out to the hull, for which it is spread with full strength
STRAIGHT_EASE = (0.006, 0.024)  # ease at the waist at which a top begins to hang straight, and hangs straight, metres
SLEEVELESS = 0.06  # position along the arm, 0 shoulder to 1 elbow, where a sleeveless garment is cut
BELT = 0.020  # half the height of the cloth that a belt pins, metres
BELT_FADE = 0.02  # metres beyond that over which the pins fade
TRUNK = 0.35  # share of arm bones in the skinning, below which a vertex belongs to the trunk

Fields = dict[str, np.ndarray]  # attributes of vertices by name, see `suit_fields`


@dataclass(frozen=True)
class Pattern:
    """A garment cut for one body.

    Attributes:
        garment: its description.
        levels: from coarse to fine.
        refine: matrices from each level's vertices to those of the next.
        fields: of the finest vertices, see `suit_fields`; and `drop`, 0 above a drop to 1 at its end.
        crotch: its height on the rest pose, metres.
        sleeve: (F,) whether a finest face belongs to a sleeve.
    """

    garment: Garment
    levels: list[Level]
    refine: list[sparse.csr_matrix]
    fields: Fields
    crotch: float
    sleeve: np.ndarray


def polyline_parameter(points: np.ndarray, line: list[np.ndarray]) -> np.ndarray:
    """Returns the parameter (n,) of the nearest point on a polyline: segment plus fraction; its ends are extended."""
    best, out = np.full(len(points), np.inf), np.zeros(len(points))
    for k, (a, b) in enumerate(pairwise(line)):
        u = (points - a) @ (b - a) / ((b - a) @ (b - a))
        distance = np.linalg.norm(points - a - np.clip(u, 0, 1)[:, None] * (b - a), axis=1)
        nearer = distance < best - 1e-9
        low, high = (-9 if k == 0 else 0), (9 if k == len(line) - 2 else 1)
        out = np.where(nearer, k + np.clip(u, low, high), out)
        best = np.minimum(best, distance)
    return out


def suit_fields(body: Body) -> Fields:
    """Returns attributes of the suit's vertices on the rest pose.

    These are x, y, z in metres; armL, armR (0 shoulder, 1 elbow, 2 wrist, -1 off the arm) and legL, legR (0 hip, 1
    knee, 2 ankle); arm_shareL, arm_shareR, the sum of the skinning weights of the arm's bones.
    """
    points, j, rig = body.tights, body.joints, makehuman.rig()
    out = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
    for side in "LR":
        arm = [
            i
            for i, b in enumerate(rig.bones)
            if b.endswith(f".{side}") and b.startswith(("upperarm", "lowerarm", "wrist"))
        ]
        arm_share = rig.weights[makehuman.TIGHTS][:, arm].sum(1)
        line = polyline_parameter(points, [j[f"{bone}.{side}"] for bone in ("upperarm01", "lowerarm01", "wrist")])
        out[f"arm_share{side}"], out[f"arm{side}"] = arm_share, np.where(arm_share > 0.05, line, -1.0)
        out[f"leg{side}"] = polyline_parameter(
            points, [j[f"{bone}.{side}"] for bone in ("upperleg01", "lowerleg01", "foot")]
        )
    return out


def landmarks(body: Body) -> dict[str, float]:
    """Returns the heights of crotch, hip, waist and neck on the rest pose, metres."""
    suit, j = body.tights, body.joints
    middle = (np.abs(suit[:, 0]) < 0.01) & (suit[:, 1] < j["root"][1] + 0.1)
    return {
        "crotch": float(suit[middle, 1].min()),
        "hip": float(j["upperleg01.L"][1]),
        "waist": float(j["spine04"][1]),
        "neck": float(j["neck01"][1]),
    }


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
        a, b, table = row - i, column - np.floor(column), self.radii
        low = table[i, j] * (1 - b) + table[i, (j + 1) % BEARINGS] * b
        high = table[i + 1, j] * (1 - b) + table[i + 1, (j + 1) % BEARINGS] * b
        return low * (1 - a) + high * a

    def straightened(self, low: float, share: float) -> "Hull":
        """Returns the hull of cloth that hangs straight over hollows along the height.

        Such hollows are between the shoulder blades and the seat, and between the chest and the belly.

        Args:
            low: height above which it hangs straight, metres.
            share: of the hollows' depth that it spans, in [0,1].
        """
        radii, first = self.radii.copy(), int(np.searchsorted(self.heights, low))
        for a in range(first, len(radii)):
            for b in range(a + 2, len(radii)):
                t = ((self.heights[a:b] - self.heights[a]) / (self.heights[b] - self.heights[a]))[:, None]
                radii[a:b] = np.maximum(radii[a:b], self.radii[a] * (1 - t) + self.radii[b] * t)
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
        fields: of the vertices, see `suit_fields`.
        heights: see `landmarks`.

    Returns:
        The hull; slices with too few vertices are interpolated between their neighbours.
    """
    trunk = points[np.maximum(fields["arm_shareL"], fields["arm_shareR"]) < 0.05]
    slices = np.arange(heights["crotch"] - SLICE, heights["neck"] - BLADES + SLICE, SLICE)
    middle = float(np.median(trunk[np.abs(trunk[:, 1] - heights["waist"]) < 0.1, 2]))
    turn = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    directions = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    known, radii = [], []
    for height in slices:
        outline = trunk[np.abs(trunk[:, 1] - height) < 0.9 * SLICE][:, [0, 2]] - [0.0, middle]
        if len(outline) < MIN_OUTLINE:
            continue
        sides = ConvexHull(outline).equations
        facing = directions @ sides[:, :2].T
        known.append(height)
        radii.append(np.min(np.where(facing > 1e-6, -sides[:, 2] / np.maximum(facing, 1e-6), np.inf), axis=1))
    return Hull(middle, slices, np.stack([np.interp(slices, known, r) for r in np.transpose(radii)], axis=1))


def expand_evenly(hull: Hull, points: np.ndarray, faces: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Moves points out to a hull (`Hull.expand`) and spreads those from the cleft between the buttocks over the seat.

    Without this, the cloth that lined the cleft would be bunched on a narrow strip, and crumple there.
    """
    out = hull.expand(points, share)
    average = neighbours(faces, len(points))
    moved = np.linalg.norm(out - points, axis=1)
    for _ in range(3):
        moved = np.maximum(moved, 0.7 * (average @ moved))
    seat = (points[:, 2] < hull.middle) & (np.abs(points[:, 0]) < SEAT[0]) & (points[:, 1] < hull.heights[0] + SEAT[1])
    moved = (seat * np.clip(moved / BUNCHED, 0, 1))[:, None] * [1.0, 0.0, 1.0]
    for _ in range(12):
        out = hull.expand(out + 0.7 * moved * (average @ out - out), share)
    return out


def neck_field(body: Body, garment: Garment, fields: Fields) -> np.ndarray:
    """Returns the metres (n,) outside the neck opening: an ellipsoid, open at the top, and a V below it in front."""
    centre = body.joints["neck01"] + np.array([0.0, 0.03, 0.035])
    wide, high, deep = garment.neck
    r = np.sqrt(
        (fields["x"] / wide) ** 2
        + ((fields["z"] - centre[2]) / deep) ** 2
        + (np.minimum(fields["y"] - centre[1], 0) / high) ** 2
    )
    out = (r - 1) * wide
    if garment.v_depth:
        half = 0.8 * wide * (fields["y"] - centre[1] + high + garment.v_depth) / (high + garment.v_depth)
        out = np.where(fields["z"] > centre[2], np.minimum(out, np.abs(fields["x"]) - half), out)
    return np.where(np.maximum(fields["arm_shareL"], fields["arm_shareR"]) > 0.3, 1.0, out)


def armhole_field(body: Body, garment: Garment, fields: Fields, side: str) -> np.ndarray:
    """Returns the metres (n,) outside the armhole of a sleeveless garment: a ball that leaves a strap at the neck."""
    centre, sign = body.joints[f"upperarm01.{side}"], 1 if side == "L" else -1
    x = np.minimum(sign * (fields["x"] - centre[0]), 0)
    r = np.sqrt(x**2 + (0.75 * (fields["y"] - centre[1])) ** 2 + (0.9 * (fields["z"] - centre[2])) ** 2)
    return np.where(sign * fields["x"] > 0, r - garment.armhole, 1.0)


def cut_fields(body: Body, garment: Garment, heights: dict[str, float]) -> list:
    """Returns functions of `Fields`; keeping where each is positive, one after the other, leaves the garment."""
    left, right = (lambda fields: fields["x"] > 0), (lambda fields: fields["x"] <= 0)
    if garment.kind == "top":
        low = hem_height(garment, heights)
        out = [lambda fields: fields["y"] - low, lambda fields: neck_field(body, garment, fields)]
        for side, on_side in (("L", left), ("R", right)):  # vertices that hardly move with the arm belong to the trunk

            def sleeve(fields: Fields, side: str = side, on_side=on_side) -> np.ndarray:
                end = SLEEVELESS if garment.armhole else garment.sleeve_end
                within = end - fields[f"arm{side}"] + 8 * np.clip(TRUNK - fields[f"arm_share{side}"], 0, 1)
                if garment.armhole:  # two cuts would leave slivers between them
                    within = np.minimum(within, armhole_field(body, garment, fields, side))
                return np.where(on_side(fields), within, 1.0)

            out.append(sleeve)
        if garment.front_gap:
            neck, chest = body.joints["neck01"], heights["hip"] + 0.2

            def widen(fields: Fields) -> np.ndarray:
                return 1 + 0.9 * np.clip((fields["y"] - chest) / (neck[1] - chest), 0, 1)

            out.append(
                lambda fields: np.where(
                    fields["z"] > neck[2] + 0.02, np.abs(fields["x"]) - garment.front_gap * widen(fields), 1.0
                )
            )
        return out
    waist = heights["waist"] + garment.waist
    out = [lambda fields: waist - fields["y"]]
    if garment.kind == "trousers":
        out.append(lambda fields: garment.leg_end - np.where(left(fields), fields["legL"], fields["legR"]))
    else:
        low = hem_height(garment, heights)
        out.append(lambda fields: fields["y"] - low)
    return out


def hem_height(garment: Garment, heights: dict[str, float]) -> float:
    """Returns the height on the rest pose down to which a garment is cut from the suit; its drop begins there."""
    return heights["crotch"] + garment.hem if garment.seam is None else heights["waist"] + garment.seam


def build_pattern(body: Body, garment: Garment, levels: int) -> Pattern:
    """Builds the pattern of a garment for a body, refined `levels` times (edges of 25, 13, 6 mm)."""
    heights, suit = landmarks(body), suit_fields(body)
    garment = with_drop_for(body, garment, heights)
    matrix, faces, sleeve = cut_from_suit(body, garment, suit, heights)
    fields = {name: matrix @ values for name, values in suit.items()}
    weights = matrix @ makehuman.rig().weights[makehuman.TIGHTS]
    weights /= weights.sum(1, keepdims=True)
    points = matrix @ body.tights
    hull = trunk_hull(body.tights, suit, heights)
    hanging = points
    if garment.kind != "trousers":
        spanned = np.clip((heights["neck"] - BLADES - points[:, 1]) / FADE, 0, 1)
        spanned *= np.clip(1 - 5 * np.maximum(fields["arm_shareL"], fields["arm_shareR"]), 0, 1)
        points = hanging = expand_evenly(hull, points, faces, spanned)
    if garment.kind == "top":
        low = hem_height(garment, heights) if garment.tuck_height is None else heights["waist"] + garment.tuck_height
        straight = 0.0 if garment.front_gap else np.interp(garment.torso_ease[1], STRAIGHT_EASE, (0.0, 1.0))
        hanging = hull.straightened(low, straight).expand(points, spanned)
    outward = smoothed(normals(points, faces), faces, 4)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    ease, lengthening = fit(body, garment, fields, heights, points, outward)
    fitted = points + outward * (PIN_OFFSET + garment.waistband_offset)
    start = hanging + lengthening + outward * np.minimum(ease, 0.006)[:, None]
    rest_shape = hanging + lengthening + outward * ease[:, None]
    fields["drop"] = np.zeros(len(points))
    level = Level(rest_shape, start, fitted, pin_weights(body, garment, fields, heights), weights, faces)
    if garment.drop:
        if garment.gather:  # gathers are finer than the suit
            matrix, split_faces, parent = split_border(faces, len(points), lowest_border(faces, fields["y"])[0])
            level, sleeve = level.resampled(matrix, split_faces), sleeve[parent]
            fields = {name: matrix @ values for name, values in fields.items()}
        level, fields = add_drop(garment, level, fields, hull)
    above_drop = fields["drop"] == 0
    level.start[above_drop] += 0.7 * (level.rest_shape - level.start)[above_drop]
    sleeve = np.r_[sleeve, np.zeros(len(level.faces) - len(sleeve), bool)]
    return refined(garment, level, fields, heights["crotch"], sleeve, levels)


def with_drop_for(body: Body, garment: Garment, heights: dict[str, float]) -> Garment:
    """Returns the garment with its drop for the length of the body's legs, and from its seam on if it has one."""
    leg = body.joints["upperleg01.L"][1] - body.joints["foot.L"][1]
    drop = garment.drop * min(1.1, leg / LEG)
    above = 0.0 if garment.seam is None else hem_height(garment, heights) - heights["crotch"] - HEM
    return replace(garment, drop=drop + above)


def cut_from_suit(
    body: Body, garment: Garment, suit: Fields, heights: dict[str, float]
) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Cuts a garment, without its drop, from the suit.

    Args:
        body: in its rest pose.
        garment: to be cut.
        suit: fields of the suit, see `suit_fields`.
        heights: see `landmarks`.

    Returns:
        The matrix from the suit's vertices to the garment's, its faces (F,3), and which of them (F,) are of sleeves.
    """
    faces = makehuman.base().faces["helper-tights"] - makehuman.TIGHTS.start
    matrix = sparse.identity(len(body.tights), format="csr")
    for cut in cut_fields(body, garment, heights):
        matrix, faces = clip(matrix, faces, cut({name: matrix @ values for name, values in suit.items()}))
    matrix, faces = largest_piece(matrix, faces)
    sleeve = np.zeros(len(faces), bool)
    if garment.kind == "top":  # edges along the armhole, where the panels of sleeve and body meet
        arm_share = matrix @ np.maximum(suit["arm_shareL"], suit["arm_shareR"])
        matrix, faces, sleeve = split(matrix, faces, arm_share - 0.5)
    return matrix, faces, sleeve


def refined(
    garment: Garment,
    coarsest: Level,
    fields: Fields,
    crotch: float,
    sleeve: np.ndarray,
    levels: int,
) -> Pattern:
    """Returns the pattern of a coarsest level, refined `levels` times; fields, crotch and sleeve as in `Pattern`."""
    refined_levels, refine = [coarsest], []
    for _ in range(levels):
        coarse = refined_levels[-1]
        matrix, faces = loop(coarse.faces, len(coarse.rest_shape))
        refine.append(matrix)
        sleeve = np.tile(sleeve, 4)
        refined_levels.append(coarse.resampled(matrix, faces))
        fields = {name: matrix @ values for name, values in fields.items()}
    return Pattern(garment, refined_levels, refine, fields, crotch, sleeve)


def largest_piece(matrix: sparse.csr_matrix, faces: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Returns the largest connected piece; a cut may leave small others."""
    label = sparse.csgraph.connected_components(neighbours(faces, matrix.shape[0]))[1][faces[:, 0]]
    return compacted(matrix, faces[label == np.bincount(label).argmax()])


def fit(
    body: Body,
    garment: Garment,
    fields: Fields,
    heights: dict[str, float],
    points: np.ndarray,
    outward: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Computes how a garment's pattern differs from the suit that it is cut from.

    Args:
        body: in its rest pose.
        garment: to be cut.
        fields: of the vertices, see `suit_fields`.
        heights: of the body, see `landmarks`.
        points: (n,3) vertices of the suit, metres.
        outward: (n,3) their unit normals.

    Returns:
        The ease (n,), metres along the normals, and the displacement (n,3), metres, that lengthens trunk and limbs.
    """
    down, lengthening = np.array([0.0, -1.0, 0.0]), np.zeros_like(points)
    if garment.kind == "top":
        up = (fields["y"] - heights["crotch"]) / (heights["neck"] - heights["crotch"])
        arm, on_arm = (
            np.maximum(fields["armL"], fields["armR"]),
            np.clip(np.maximum(fields["arm_shareL"], fields["arm_shareR"]), 0, 1),
        )
        ease = (
            np.interp(up, TORSO_AT, garment.torso_ease) * (1 - on_arm)
            + np.interp(arm, ARM_AT, garment.arm_ease) * on_arm
        )
        lengthening = lengthening + down * (np.clip(1 - up, 0, 1) * (1 - on_arm) * garment.slack)[:, None]
        for side in "LR":
            axis = body.joints[f"wrist.{side}"] - body.joints[f"upperarm01.{side}"]
            share = np.clip(fields[f"arm{side}"], 0, 2) / 2 * np.clip(fields[f"arm_share{side}"], 0, 1)
            lengthening = lengthening + (share * garment.sleeve_slack)[:, None] * axis / np.linalg.norm(axis)
        return ease, lengthening
    leg = np.where(fields["x"] > 0, fields["legL"], fields["legR"])
    ease = np.interp(leg, LEG_AT, garment.leg_ease)
    if garment.kind == "trousers":
        lengthening = lengthening + down * (np.clip(leg, 0, 2) / 2 * garment.leg_slack)[:, None]
        inner = outward[:, 0] * np.sign(points[:, 0]) < -0.3
        room = np.maximum(np.abs(points[:, 0]) - 0.004, 0)
        ease = np.where(inner, np.minimum(ease, room), ease)  # the legs of a wide pattern must not cross
    return ease, lengthening


def pin_weights(body: Body, garment: Garment, fields: Fields, heights: dict[str, float]) -> np.ndarray:
    """Returns how firmly each vertex (n,) is pinned to the body, in [0,1]."""
    arm, leg = np.maximum(fields["armL"], fields["armR"]), np.where(fields["x"] > 0, fields["legL"], fields["legR"])
    if garment.kind != "top":
        waist = np.clip(1 - (heights["waist"] + garment.waist - fields["y"]) / 0.035, 0, 1)
        cuff = np.clip((leg - (garment.leg_end - 0.05)) / 0.04, 0, 1) * garment.cuff_pin * (garment.kind == "trousers")
        return np.maximum(waist, cuff)
    out = (
        np.clip(1 - neck_field(body, garment, fields) / 0.02, 0, 1)
        * garment.neck_pin
        * (fields["y"] > heights["neck"] - 0.2)
    )
    if garment.tuck_height is not None:  # inside a waistband the cloth lies flat
        edge = heights["waist"] + garment.tuck_height
        out = np.maximum(out, 0.9 * np.clip((edge + 0.03 - fields["y"]) / 0.02, 0, 1))
    if garment.belt_height is not None:
        off = np.abs(fields["y"] - heights["waist"] - garment.belt_height)
        trunk = np.maximum(fields["arm_shareL"], fields["arm_shareR"]) < 0.1
        out = np.maximum(out, 0.95 * np.clip(1 - (off - BELT) / BELT_FADE, 0, 1) * trunk)
    out = np.maximum(out, np.clip((arm - (garment.sleeve_end - 0.07)) / 0.05, 0, 1) * garment.cuff_pin)
    rib = np.clip(1 - (fields["y"] - hem_height(garment, heights)) / 0.03, 0, 1) * (
        np.maximum(fields["arm_shareL"], fields["arm_shareR"]) < 0.1
    )
    return np.maximum(out, rib * garment.hem_pin)


def lowest_border(faces: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, bool]:
    """Finds the lowest part of the border of a garment as it was cut, with heights y (n,).

    Returns:
        Its vertices (m,) in order, and whether it is a closed loop.
    """
    ring = min(border_loops(faces), key=lambda ring: y[ring].min())
    low = y[ring] < y[ring].min() + 0.003
    if low.all():
        return ring, True
    # a garment open in front has one border all round, of which only the longest run at the bottom counts
    starts = np.flatnonzero(low & ~np.roll(low, 1))
    return max((np.roll(ring, -k)[: int(np.argmin(np.roll(low, -k)))] for k in starts), key=len), False


def split_border(faces: np.ndarray, n: int, ring: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Splits the border edges between vertices of `ring` (m,) in the middle; each face has at most one of them.

    Returns:
        The matrix (n+e,n) from n vertices to those with the e middles, the faces, and the face that each comes from.
    """
    on_ring = np.zeros(n, bool)
    on_ring[ring] = True
    sides = rim(faces)
    border = {tuple(side) for side in sides[on_ring[sides].all(1)].tolist()}
    out: list[list[int]] = []
    parent: list[int] = []
    ends: list[list[int]] = []
    for number, face in enumerate(faces.tolist()):
        rotated = [face[k:] + face[:k] for k in range(3)]
        on_border = next((corners for corners in rotated if tuple(corners[:2]) in border), None)
        if on_border is None:
            out.append(face)
            parent.append(number)
        else:
            a, b, c = on_border
            middle = n + len(ends)
            ends.append([a, b])
            out += [[a, middle, c], [middle, b, c]]
            parent += [number, number]
    row = np.repeat(np.arange(len(ends)), 2)
    middles = sparse.csr_matrix((np.full(len(row), 0.5), (row, np.ravel(ends))), shape=(len(ends), n))
    return sparse.vstack([sparse.identity(n, format="csr"), middles]).tocsr(), np.array(out), np.array(parent)


def wave_profile(garment: Garment, angle: np.ndarray) -> np.ndarray:
    """Returns the height (n,) in [0,1] of a drop's irregular folds at bearings (n,)."""
    uneven = 0.5 * np.sin(3 * angle + garment.fold_phase) + 0.4 * np.sin(5 * angle + 2.3 * garment.fold_phase)
    return 0.5 + 0.5 * np.sin(garment.fold_count * angle + uneven + 4.1 * garment.fold_phase)


def rounded(flat: np.ndarray, centre: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Returns an outline (m,2) pushed out to its convex hull, which bridges the hollow between the legs."""
    outline = flat[ConvexHull(flat).vertices]
    radius = np.linalg.norm(outline - centre, axis=1)
    bearing = np.arctan2(outline[:, 1] - centre[1], outline[:, 0] - centre[0])
    order = np.argsort(bearing)
    hull_radius = np.interp(angle, bearing[order], radius[order], period=2 * np.pi)
    direction = np.stack([np.cos(angle), np.sin(angle)], 1)
    return centre + direction * np.maximum(hull_radius, np.linalg.norm(flat - centre, axis=1))[:, None]


def drop_rows(
    garment: Garment, top: np.ndarray, cut_height: np.ndarray, closed: bool, hull: Hull
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Computes the rows of a drop.

    What is cut wider than it hangs starts the simulation in folds of the same length.

    Args:
        garment: its drop, flare and folds.
        top: (m,3) vertices of the border on which the drop hangs, metres.
        cut_height: (m,) heights of these vertices as cut.
        closed: whether the border is a closed loop.
        hull: of the trunk.

    Returns:
        The rows (m,3) as cut, and the rows (m,3) at the start of the simulation.
    """
    flat = top[:, [0, 2]]
    centre = flat.mean(0)
    angle = np.arctan2(flat[:, 1] - centre[1], flat[:, 0] - centre[0])
    round_ = rounded(flat, centre, angle) if closed else flat.copy()
    wave = wave_profile(garment, angle)

    def length(outline: np.ndarray) -> float:
        return float(np.linalg.norm(np.roll(outline, -1, 0) - outline, axis=1)[: len(top) - (not closed)].sum())

    def row_outline(s: float, flare: float, depth: float) -> np.ndarray:
        """Returns the row (m,2) at the share s of the drop, wider by a flare, with folds of a depth in metres."""
        y = cut_height - garment.drop * s
        ring = centre + (flat + (round_ - flat) * min(1.0, 5 * s) - centre)
        out = centre + (ring - centre) * (1 + flare * s)
        r = np.linalg.norm(out - centre, axis=1)
        widest = r
        if closed:
            at = np.stack([out[:, 0], y, out[:, 1]], axis=1)
            widest = np.maximum(r, np.where(y > hull.heights[0], hull.radius(at) + HIP_CLEARANCE, 0))
        return centre + (out - centre) * ((widest + 2 * depth * wave) / r)[:, None]

    cut_rows: list[np.ndarray] = []
    start_rows: list[np.ndarray] = []
    count = max(2, round(garment.drop / ROW))
    for k in range(1, count + 1):
        s = k / count
        r = np.linalg.norm(row_outline(s, garment.flare, 0.0) - centre, axis=1).mean()
        depth = garment.gather * min(1.0, garment.drop * s / GATHERED) + garment.pleat * s
        cut = row_outline(s, garment.flare, depth * r)
        hanging, low, high = cut, 0.0, 0.5 * r
        for _ in range(12):  # bisection for the depth of the folds at which the row is as long as it is cut
            middle = (low + high) / 2
            hanging = row_outline(s, HANGING_FLARE * garment.flare, middle)
            low, high = (low, middle) if length(hanging) > length(cut) else (middle, high)
        for rows, outline in ((cut_rows, cut), (start_rows, hanging)):
            rows.append(np.stack([outline[:, 0], top[:, 1] - garment.drop * s, outline[:, 1]], axis=1))
    return cut_rows, start_rows


def add_drop(garment: Garment, level: Level, fields: Fields, hull: Hull) -> tuple[Level, Fields]:
    """Continues the lowest border downward: skirts, coat tails, shirt tails. A drop moves with the pelvis.

    Returns:
        The level and the fields with the drop.
    """
    ring, closed = lowest_border(level.faces, fields["y"])
    cut_rows, start_rows = drop_rows(garment, level.rest_shape[ring].copy(), fields["y"][ring], closed, hull)
    points, strip = extruded(ring, cut_rows, len(level.rest_shape), closed)
    start, count = np.concatenate(start_rows), len(cut_rows)
    down = np.repeat(np.arange(1, count + 1) / count, len(ring))
    root = np.zeros(level.weights.shape[1])
    root[0] = 1
    root_share = np.clip(4 * down, 0, 1)[:, None]
    weights = np.tile(level.weights[ring], (count, 1)) * (1 - root_share) + root * root_share
    fields = {name: np.r_[values, np.tile(values[ring], count)] for name, values in fields.items()}
    fields["drop"][len(level.rest_shape) :] = down
    whole = Level(
        np.concatenate([level.rest_shape, points]),
        np.concatenate([level.start, start]),
        np.concatenate([level.fitted, start]),
        np.r_[level.pin_weight, np.zeros(len(points))],
        np.concatenate([level.weights, weights]),
        np.concatenate([level.faces, strip]),
    )
    return whole, fields
