"""From a garment's description and a body to its pattern: cut, eased, lengthened, extended and refined."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import ConvexHull

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.drape import Level
from relight.figures.garments import ARM_AT, LEG_AT, TORSO_AT, Garment
from relight.figures.surfaces import border_loops, clip, extruded, loop, neighbours, normals, rim, smoothed, split

NUDE = 0.004  # metres outside the suit at which cuffs, waistbands and necklines are held
HEM = 0.06  # metres above the crotch: where the drop of a garment with a seam at the waist begins to count
LEG = 0.82  # metres from hip to ankle for which the drops are given
ROW = 0.028  # metres between the rows of a drop
GATHERED = 0.06  # metres of a drop within which gathers reach their depth
FALL = 0.35  # of its flare, a drop's width as it hangs
HIPS = 0.014  # metres that a drop keeps off the hull of the hips
BEARINGS = 96  # directions in which the hull of the trunk is measured
SLICE = 0.02  # metres between the heights at which it is measured
OUTLINE = 6  # vertices that a slice needs to outline the trunk; those of a tall person are further apart
BLADES = 0.06  # metres below the base of the neck: up to where cloth spans the hollow of the spine
FADE = 0.12  # metres below that within which it begins to
SEAT = (0.06, 0.25)  # metres from the middle, and above the crotch, within which the cleft between the buttocks is
BUNCHED = 0.012  # metres moved out to the hull, from which on cloth is spread wholly
HUNG = (0.006, 0.024)  # metres of ease at the waist: from where on, and from where on wholly, a top hangs straight
SLEEVELESS = 0.06  # of the arm, where what is beyond an armhole ends
BELT = 0.020  # metres above and below the middle of a belt within which it holds the cloth
EASED = 0.02  # metres beyond that within which the cloth comes free
TRUNK = 0.35  # share of the arm in the skinning, below which a vertex belongs to the trunk


@dataclass(frozen=True)
class Pattern:
    """levels: coarse to fine; refine: matrices between them; fields: attributes of the finest vertices (see `fields`),
    plus `tube`, 0 to 1 down a drop; crotch: height on the rest pose;
    sleeve (F,): whether a finest face belongs to a sleeve."""

    garment: Garment
    levels: list[Level]
    refine: list[sparse.csr_matrix]
    fields: dict[str, np.ndarray]
    crotch: float
    sleeve: np.ndarray


def along(points: np.ndarray, line: list[np.ndarray]) -> np.ndarray:
    """Parameter on a polyline of the point nearest to each point (n,3): segment number plus fraction, ends extended."""
    best, out = np.full(len(points), np.inf), np.zeros(len(points))
    for k, (a, b) in enumerate(pairwise(line)):
        u = (points - a) @ (b - a) / ((b - a) @ (b - a))
        distance = np.linalg.norm(points - a - np.clip(u, 0, 1)[:, None] * (b - a), axis=1)
        nearer = distance < best - 1e-9
        low, high = (-9 if k == 0 else 0), (9 if k == len(line) - 2 else 1)
        out = np.where(nearer, k + np.clip(u, low, high), out)
        best = np.minimum(best, distance)
    return out


def suit_fields(body: Body) -> dict[str, np.ndarray]:
    """For the suit's vertices on the rest pose: x, y, z metres; armL, armR (0 shoulder, 1 elbow, 2 wrist), onL, onR the
    share of arm bones in the skinning; legL, legR (0 hip, 1 knee, 2 ankle)."""
    points, j, rig = body.tights, body.joints, makehuman.rig()
    out = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
    for side in "LR":
        arm = [
            i
            for i, b in enumerate(rig.bones)
            if b.endswith(f".{side}") and b.startswith(("upperarm", "lowerarm", "wrist"))
        ]
        on = rig.weights[makehuman.TIGHTS][:, arm].sum(1)
        line = along(points, [j[f"{bone}.{side}"] for bone in ("upperarm01", "lowerarm01", "wrist")])
        out[f"on{side}"], out[f"arm{side}"] = on, np.where(on > 0.05, line, -1.0)
        out[f"leg{side}"] = along(points, [j[f"{bone}.{side}"] for bone in ("upperleg01", "lowerleg01", "foot")])
    return out


def landmarks(body: Body) -> dict[str, float]:
    """Heights on the rest pose: crotch, hip, waist, neck."""
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
    """The convex hull of the trunk, slice by slice: cloth spans what lies hollow, as the small of the back and what is
    between the buttocks, and has no length for it. middle: z of the axis; heights (k,); radii (k,BEARINGS)."""

    middle: float
    heights: np.ndarray
    radii: np.ndarray

    def radius(self, points: np.ndarray) -> np.ndarray:
        """Metres (n,) from the axis to the hull, at the height and in the direction of points (n,3)."""
        row = np.interp(points[:, 1], self.heights, np.arange(len(self.heights)))
        column = np.arctan2(points[:, 0], points[:, 2] - self.middle) % (2 * np.pi) * BEARINGS / (2 * np.pi)
        i, j = np.minimum(row.astype(int), len(self.heights) - 2), column.astype(int) % BEARINGS
        a, b, table = row - i, column - np.floor(column), self.radii
        low = table[i, j] * (1 - b) + table[i, (j + 1) % BEARINGS] * b
        high = table[i + 1, j] * (1 - b) + table[i + 1, (j + 1) % BEARINGS] * b
        return low * (1 - a) + high * a

    def hung(self, low: float, share: float) -> "Hull":
        """The hull of cloth that hangs straight over the hollows above the height `low`, from the shoulder blades over
        the small of the back to the seat and from the chest to the belly, by a share in [0,1] of their depth."""
        radii, first = self.radii.copy(), int(np.searchsorted(self.heights, low))
        for a in range(first, len(radii)):
            for b in range(a + 2, len(radii)):
                t = ((self.heights[a:b] - self.heights[a]) / (self.heights[b] - self.heights[a]))[:, None]
                radii[a:b] = np.maximum(radii[a:b], self.radii[a] * (1 - t) + self.radii[b] * t)
        return replace(self, radii=self.radii + share * (radii - self.radii))

    def spanned(self, points: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Points (n,3) moved out to the hull by a share (n,) of what they lie inside it."""
        flat = points[:, [0, 2]] - [0.0, self.middle]
        r = np.maximum(np.linalg.norm(flat, axis=1), 1e-6)
        flat = flat * (1 + share * np.maximum(self.radius(points) - r, 0) / r)[:, None]
        return np.stack([flat[:, 0], points[:, 1], flat[:, 1] + self.middle], axis=1)


def trunk_hull(points: np.ndarray, f: dict[str, np.ndarray], at: dict[str, float]) -> Hull:
    """The hull of the suit's vertices (n,3) with their fields, from below the crotch to the shoulder blades. Heights
    with too few vertices are interpolated between their neighbours."""
    trunk = points[np.maximum(f["onL"], f["onR"]) < 0.05]
    heights = np.arange(at["crotch"] - SLICE, at["neck"] - BLADES + SLICE, SLICE)
    middle = float(np.median(trunk[np.abs(trunk[:, 1] - at["waist"]) < 0.1, 2]))
    turn = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    ways = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    known, radii = [], []
    for height in heights:
        near = trunk[np.abs(trunk[:, 1] - height) < 0.9 * SLICE][:, [0, 2]] - [0.0, middle]
        if len(near) < OUTLINE:
            continue
        sides = ConvexHull(near).equations
        facing = ways @ sides[:, :2].T
        known.append(height)
        radii.append(np.min(np.where(facing > 1e-6, -sides[:, 2] / np.maximum(facing, 1e-6), np.inf), axis=1))
    return Hull(middle, heights, np.stack([np.interp(heights, known, r) for r in np.transpose(radii)], axis=1))


def unbunched(hull: Hull, points: np.ndarray, faces: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Points (n,3) `spanned` by a hull, as far from each other as beside it: what lined the cleft between the buttocks
    would be so much cloth on a narrow strip, and crumple there."""
    out = hull.spanned(points, share)
    around = neighbours(faces, len(points))
    moved = np.linalg.norm(out - points, axis=1)
    for _ in range(3):
        moved = np.maximum(moved, 0.7 * (around @ moved))
    seat = (points[:, 2] < hull.middle) & (np.abs(points[:, 0]) < SEAT[0]) & (points[:, 1] < hull.heights[0] + SEAT[1])
    moved = (seat * np.clip(moved / BUNCHED, 0, 1))[:, None] * [1.0, 0.0, 1.0]
    for _ in range(12):
        out = hull.spanned(out + 0.7 * moved * (around @ out - out), share)
    return out


def neck_field(body: Body, garment: Garment, f: dict[str, np.ndarray]) -> np.ndarray:
    """Metres outside the neck opening: an ellipsoid about the neck, open at the top, and the V below it in front."""
    centre = body.joints["neck01"] + np.array([0.0, 0.03, 0.035])
    wide, high, deep = garment.neck
    r = np.sqrt(
        (f["x"] / wide) ** 2 + ((f["z"] - centre[2]) / deep) ** 2 + (np.minimum(f["y"] - centre[1], 0) / high) ** 2
    )
    out = (r - 1) * wide
    if garment.vee:
        half = 0.8 * wide * (f["y"] - centre[1] + high + garment.vee) / (high + garment.vee)
        out = np.where(f["z"] > centre[2], np.minimum(out, np.abs(f["x"]) - half), out)
    return np.where(np.maximum(f["onL"], f["onR"]) > 0.3, 1.0, out)


def armhole_field(body: Body, garment: Garment, f: dict[str, np.ndarray], side: str) -> np.ndarray:
    """Metres outside the armhole of a sleeveless garment: a ball about the shoulder, that leaves a strap beside the
    neck."""
    centre, sign = body.joints[f"upperarm01.{side}"], 1 if side == "L" else -1
    x = np.minimum(sign * (f["x"] - centre[0]), 0)
    r = np.sqrt(x**2 + (0.75 * (f["y"] - centre[1])) ** 2 + (0.9 * (f["z"] - centre[2])) ** 2)
    return np.where(sign * f["x"] > 0, r - garment.armhole, 1.0)


def cuts(body: Body, garment: Garment, at: dict[str, float]) -> list:
    """The fields whose positive parts, one after the other, leave the garment."""
    left, right = (lambda f: f["x"] > 0), (lambda f: f["x"] <= 0)
    if garment.kind == "top":
        low = hem(garment, at)
        out = [lambda f: f["y"] - low, lambda f: neck_field(body, garment, f)]
        for side, there in (("L", left), ("R", right)):  # what hardly moves with the arm is no sleeve

            def sleeve(f: dict[str, np.ndarray], side: str = side, there=there) -> np.ndarray:
                end = SLEEVELESS if garment.armhole else garment.sleeve
                within = end - f[f"arm{side}"] + 8 * np.clip(TRUNK - f[f"on{side}"], 0, 1)
                if garment.armhole:  # one cut, not two: there would be slivers between them
                    within = np.minimum(within, armhole_field(body, garment, f, side))
                return np.where(there(f), within, 1.0)

            out.append(sleeve)
        if garment.open:
            neck, chest = body.joints["neck01"], at["hip"] + 0.2

            def widen(f: dict[str, np.ndarray]) -> np.ndarray:
                return 1 + 0.9 * np.clip((f["y"] - chest) / (neck[1] - chest), 0, 1)

            out.append(lambda f: np.where(f["z"] > neck[2] + 0.02, np.abs(f["x"]) - garment.open * widen(f), 1.0))
        return out
    waist = at["waist"] + garment.waist
    out = [lambda f: waist - f["y"]]
    if garment.kind == "trousers":
        out.append(lambda f: garment.leg - np.where(left(f), f["legL"], f["legR"]))
    else:
        low = hem(garment, at)
        out.append(lambda f: f["y"] - low)
    return out


def hem(garment: Garment, at: dict[str, float]) -> float:
    """Height on the rest pose to which a garment is cut from the suit, and from which on its drop hangs."""
    return at["crotch"] + garment.hem if garment.seam is None else at["waist"] + garment.seam


def build_pattern(body: Body, garment: Garment, levels: int) -> Pattern:
    """The pattern of `garment` for `body`, refined `levels` times (edges 25, 13, 6 mm)."""
    at, f0 = landmarks(body), suit_fields(body)
    leg = body.joints["upperleg01.L"][1] - body.joints["foot.L"][1]
    drop = garment.drop * min(1.1, leg / LEG)  # skirts and coats as long as the legs ask, from the hips on
    garment = replace(garment, drop=drop + (0.0 if garment.seam is None else hem(garment, at) - at["crotch"] - HEM))
    faces = makehuman.base().faces["helper-tights"] - makehuman.TIGHTS.start
    matrix = sparse.identity(len(body.tights), format="csr")
    for cut in cuts(body, garment, at):
        matrix, faces = clip(matrix, faces, cut({name: matrix @ values for name, values in f0.items()}))
    matrix, faces = largest(matrix, faces)
    sleeve = np.zeros(len(faces), bool)
    if garment.kind == "top":  # edges along the armhole, where the panels of sleeve and body meet
        on = matrix @ np.maximum(f0["onL"], f0["onR"])
        matrix, faces, sleeve = split(matrix, faces, on - 0.5)
    f = {name: matrix @ values for name, values in f0.items()}
    weights = matrix @ makehuman.rig().weights[makehuman.TIGHTS]
    weights /= weights.sum(1, keepdims=True)
    points = matrix @ body.tights
    hull = trunk_hull(body.tights, f0, at)
    hanging = points
    if garment.kind != "trousers":
        high = np.clip((at["neck"] - BLADES - points[:, 1]) / FADE, 0, 1)
        high *= np.clip(1 - 5 * np.maximum(f["onL"], f["onR"]), 0, 1)
        points = hanging = unbunched(hull, points, faces, high)
    if garment.kind == "top":
        low = hem(garment, at) if garment.tuck is None else at["waist"] + garment.tuck
        straight = 0.0 if garment.open else np.interp(garment.torso[1], HUNG, (0.0, 1.0))
        hanging = hull.hung(low, straight).spanned(points, high)
    outward = smoothed(normals(points, faces), faces, 4)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    ease, longer = fit(body, garment, f, at, points, outward)
    held = points + outward * (NUDE + garment.over)
    start = hanging + longer + outward * np.minimum(ease, 0.006)[:, None]
    pattern = hanging + longer + outward * ease[:, None]
    f["tube"] = np.zeros(len(points))
    level = Level(pattern, start, held, pins(body, garment, f, at), weights, faces)
    if garment.drop:
        if garment.gather:  # gathers are finer than the suit
            more, doubled_faces, parent = doubled(faces, len(points), lowest(faces, f["y"])[0])
            level, sleeve = level.mapped(more, doubled_faces), sleeve[parent]
            f = {name: more @ values for name, values in f.items()}
        level, f = dropped(garment, level, f, hull)
    sewn = f["tube"] == 0
    level.start[sewn] += 0.7 * (level.pattern - level.start)[sewn]
    sleeve = np.r_[sleeve, np.zeros(len(level.faces) - len(sleeve), bool)]
    return refined(garment, level, f, at["crotch"], sleeve, levels)


def refined(
    garment: Garment,
    coarsest: Level,
    f: dict[str, np.ndarray],
    crotch: float,
    sleeve: np.ndarray,
    levels: int,
) -> Pattern:
    """The pattern of the coarsest level, refined `levels` times. f, crotch, sleeve: of that level, as of `Pattern`."""
    out, refine = [coarsest], []
    for _ in range(levels):
        coarse = out[-1]
        up, finer = loop(coarse.faces, len(coarse.pattern))
        refine.append(up)
        sleeve = np.tile(sleeve, 4)
        out.append(coarse.mapped(up, finer))
        f = {name: up @ values for name, values in f.items()}
    return Pattern(garment, out, refine, f, crotch, sleeve)


def largest(matrix: sparse.csr_matrix, faces: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """The largest connected piece: a cut may leave crumbs."""
    from relight.figures.surfaces import compacted

    label = sparse.csgraph.connected_components(neighbours(faces, matrix.shape[0]))[1][faces[:, 0]]
    return compacted(matrix, faces[label == np.bincount(label).argmax()])


def fit(
    body: Body, garment: Garment, f: dict, at: dict, points: np.ndarray, outward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far a garment's pattern is from the suit that it is cut from.

    Args:
        body: in its rest pose.
        garment: to be cut.
        f: fields of the vertices, see `suit_fields`.
        at: heights of the body, see `landmarks`.
        points: (n,3) vertices of the suit, metres.
        outward: (n,3) their unit normals.

    Returns:
        The ease (n,), metres along the normals, and the displacement (n,3), metres, that lengthens trunk and limbs.
    """
    down, longer = np.array([0.0, -1.0, 0.0]), np.zeros_like(points)
    if garment.kind == "top":
        up = (f["y"] - at["crotch"]) / (at["neck"] - at["crotch"])
        arm, on = np.maximum(f["armL"], f["armR"]), np.clip(np.maximum(f["onL"], f["onR"]), 0, 1)
        ease = np.interp(up, TORSO_AT, garment.torso) * (1 - on) + np.interp(arm, ARM_AT, garment.arm) * on
        longer = longer + down * (np.clip(1 - up, 0, 1) * (1 - on) * garment.slack)[:, None]
        for side in "LR":
            axis = body.joints[f"wrist.{side}"] - body.joints[f"upperarm01.{side}"]
            share = np.clip(f[f"arm{side}"], 0, 2) / 2 * np.clip(f[f"on{side}"], 0, 1)
            longer = longer + (share * garment.sleeve_slack)[:, None] * axis / np.linalg.norm(axis)
        return ease, longer
    leg = np.where(f["x"] > 0, f["legL"], f["legR"])
    ease = np.interp(leg, LEG_AT, garment.legs)
    if garment.kind == "trousers":
        longer = longer + down * (np.clip(leg, 0, 2) / 2 * garment.leg_slack)[:, None]
        inner = outward[:, 0] * np.sign(points[:, 0]) < -0.3
        room = np.maximum(np.abs(points[:, 0]) - 0.004, 0)
        ease = np.where(inner, np.minimum(ease, room), ease)  # the legs of a wide pattern must not cross
    return ease, longer


def pins(body: Body, garment: Garment, f: dict, at: dict) -> np.ndarray:
    """How firmly each vertex is held to the body, in [0,1]."""
    arm, leg = np.maximum(f["armL"], f["armR"]), np.where(f["x"] > 0, f["legL"], f["legR"])
    if garment.kind != "top":
        waist = np.clip(1 - (at["waist"] + garment.waist - f["y"]) / 0.035, 0, 1)
        cuff = np.clip((leg - (garment.leg - 0.05)) / 0.04, 0, 1) * garment.cuff * (garment.kind == "trousers")
        return np.maximum(waist, cuff)
    out = np.clip(1 - neck_field(body, garment, f) / 0.02, 0, 1) * garment.grip * (f["y"] > at["neck"] - 0.2)
    if garment.tuck is not None:  # inside a waistband the cloth lies flat
        edge = at["waist"] + garment.tuck
        out = np.maximum(out, 0.9 * np.clip((edge + 0.03 - f["y"]) / 0.02, 0, 1))
    if garment.belt is not None:
        off = np.abs(f["y"] - at["waist"] - garment.belt)
        trunk = np.maximum(f["onL"], f["onR"]) < 0.1
        out = np.maximum(out, 0.95 * np.clip(1 - (off - BELT) / EASED, 0, 1) * trunk)
    out = np.maximum(out, np.clip((arm - (garment.sleeve - 0.07)) / 0.05, 0, 1) * garment.cuff)
    rib = np.clip(1 - (f["y"] - hem(garment, at)) / 0.03, 0, 1) * (np.maximum(f["onL"], f["onR"]) < 0.1)
    return np.maximum(out, rib * garment.rib)


def lowest(faces: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, bool]:
    """The lowest border (m,), and whether it is a whole loop. y (n,): heights as cut."""
    ring = min(border_loops(faces), key=lambda ring: y[ring].min())
    low = y[ring] < y[ring].min() + 0.003
    if low.all():
        return ring, True
    starts = np.flatnonzero(low & ~np.roll(low, 1))  # an open front is one border all round: only its bottom run
    return max((np.roll(ring, -k)[: int(np.argmin(np.roll(low, -k)))] for k in starts), key=len), False


def doubled(faces: np.ndarray, n: int, ring: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """A surface with one vertex more in the middle of the border sides between vertices of `ring` (m,), one of a face.

    Returns the matrix (n+m,n) to its vertices, its faces, and the face that each of them is of.
    """
    on = np.zeros(n, bool)
    on[ring] = True
    sides = rim(faces)
    hems = {tuple(side) for side in sides[on[sides].all(1)].tolist()}
    out: list[list[int]] = []
    parent: list[int] = []
    ends: list[list[int]] = []
    for number, face in enumerate(faces.tolist()):
        turned = [face[k:] + face[:k] for k in range(3)]
        a, b, c = next((turn for turn in turned if tuple(turn[:2]) in hems), (-1, -1, -1))
        pieces = [face] if a < 0 else [[a, n + len(ends), c], [n + len(ends), b, c]]
        ends += [] if a < 0 else [[a, b]]
        out += pieces
        parent += [number] * len(pieces)
    row = np.repeat(np.arange(len(ends)), 2)
    middle = sparse.csr_matrix((np.full(len(row), 0.5), (row, np.ravel(ends))), shape=(len(ends), n))
    return sparse.vstack([sparse.identity(n, format="csr"), middle]).tocsr(), np.array(out), np.array(parent)


def waves(garment: Garment, angle: np.ndarray) -> np.ndarray:
    """The folds of a drop: a height in [0,1] for each bearing (n,), uneven as cloth falls, in another place for every
    piece (`garment.turn`)."""
    uneven = 0.5 * np.sin(3 * angle + garment.turn) + 0.4 * np.sin(5 * angle + 2.3 * garment.turn)
    return 0.5 + 0.5 * np.sin(garment.waves * angle + uneven + 4.1 * garment.turn)


def dropped(
    garment: Garment, level: Level, f: dict[str, np.ndarray], hull: Hull
) -> tuple[Level, dict[str, np.ndarray]]:
    """Continues the lowest border downward: skirts, coat tails, shirt tails. The drop hangs from the pelvis.

    Returns the level and the fields with the drop.
    """
    ring, closed = lowest(level.faces, f["y"])
    top = level.pattern[ring].copy()
    flat = top[:, [0, 2]]
    centre = flat.mean(0)
    angle = np.arctan2(flat[:, 1] - centre[1], flat[:, 0] - centre[0])
    round_ = flat.copy()
    if closed:  # bridge the hollow between the legs: push the outline out to its convex hull
        outline = flat[ConvexHull(flat).vertices]
        radius = np.linalg.norm(outline - centre, axis=1)
        bearing = np.arctan2(outline[:, 1] - centre[1], outline[:, 0] - centre[0])
        order = np.argsort(bearing)
        full = np.interp(angle, bearing[order], radius[order], period=2 * np.pi)
        unit = np.stack([np.cos(angle), np.sin(angle)], 1)
        round_ = centre + unit * np.maximum(full, np.linalg.norm(flat - centre, axis=1))[:, None]
    count = max(2, round(garment.drop / ROW))
    rows: list[np.ndarray] = []
    folded: list[np.ndarray] = []
    wave = waves(garment, angle)

    def length(outline: np.ndarray) -> float:
        return float(np.linalg.norm(np.roll(outline, -1, 0) - outline, axis=1)[: len(ring) - (not closed)].sum())

    for k in range(1, count + 1):
        s = k / count
        y = f["y"][ring] - garment.drop * s
        ring_at = centre + (flat + (round_ - flat) * min(1.0, 5 * s) - centre)

        def outline(flare: float, deep: float, y=y, s=s, ring_at=ring_at) -> np.ndarray:
            """The row (m,2), this much wider than the ring, outside the hips, and with waves so deep (metres)."""
            out = centre + (ring_at - centre) * (1 + flare * s)
            r = np.linalg.norm(out - centre, axis=1)
            at = np.stack([out[:, 0], y, out[:, 1]], axis=1)
            widest = np.maximum(r, np.where(y > hull.heights[0], hull.radius(at) + HIPS, 0)) if closed else r
            return centre + (out - centre) * ((widest + 2 * deep * wave) / r)[:, None]

        r = np.linalg.norm(outline(garment.flare, 0.0) - centre, axis=1).mean()
        deep = garment.gather * min(1.0, garment.drop * s / GATHERED) + garment.pleat * s
        cut = outline(garment.flare, deep * r)
        fallen, low, high = cut, 0.0, 0.5 * r  # what is cut wider than it hangs starts in folds of the same length
        for _ in range(12):
            middle = (low + high) / 2
            fallen = outline(FALL * garment.flare, middle)
            low, high = (low, middle) if length(fallen) > length(cut) else (middle, high)
        for out, row in ((rows, cut), (folded, fallen)):
            out.append(np.stack([row[:, 0], top[:, 1] - garment.drop * s, row[:, 1]], axis=1))
    points, strip = extruded(ring, rows, len(level.pattern), closed)
    hung = np.concatenate(folded)
    tube = np.repeat(np.arange(1, count + 1) / count, len(ring))
    root = np.zeros(level.weights.shape[1])
    root[0] = 1
    stiff = np.clip(4 * tube, 0, 1)[:, None]
    more = np.tile(level.weights[ring], (count, 1)) * (1 - stiff) + root * stiff
    f = {name: np.r_[values, np.tile(values[ring], count)] for name, values in f.items()}
    f["tube"][len(level.pattern) :] = tube
    whole = Level(
        np.concatenate([level.pattern, points]),
        np.concatenate([level.start, hung]),
        np.concatenate([level.held, hung]),
        np.r_[level.pinned, np.zeros(len(points))],
        np.concatenate([level.weights, more]),
        np.concatenate([level.faces, strip]),
    )
    return whole, f
