"""Builds shoes: an upper cut from the foot of the suit, narrowed at the toes, on a sole with a heel."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import ConvexHull

from relight.figures import surfaces
from relight.figures.body import makehuman
from relight.figures.body.motion import Motion
from relight.figures.body.shape import Body
from relight.figures.draw.shoes import Shoe

STRAPS = ((0.60, 0.80), (0.36, 0.44))  # start and end of the straps across the foot, from heel (0) to toes (1)
LACE_STEP = 0.017  # metres between bands of laces
HALF_LACE, HALF_LACE_WIDTH = 0.021, 0.0032  # half the length and half the width of a band, metres
LACE_THICKNESS, STRAP_THICKNESS, UPPER_THICKNESS = 0.0025, 0.003, 0.004  # metres
HEEL, HEEL_BREAST = 0.36, 0.04  # where a heel ends, and over what length it does, in lengths of the sole
OUTLINE_POINTS = 72  # of a sole; even
TOES = "toe3-1"  # the bone, at the ball of the foot, with which a shoe bends
BEND = 0.03  # length over which it bends there, metres
BALL_REACH, HEEL_REACH = 0.025, 0.06  # metres around the ball and from the heel's end, where a foot stands
INSOLE = 0.004  # height of the insole over the ground of SOLE_ROWS, metres
# Rows of a sole, from its top to its bottom: metres outward from the outline, and the height above the bare foot's
# ground: metres where positive, else shares of the thickness of the sole, which lies below that ground.
SOLE_ROWS = ((-0.020, INSOLE), (-0.0025, 0.006), (0.0, 0.002), (-0.0005, -0.5), (-0.001, -0.96), (-0.005, -1.0))
ShoePart = tuple[str, surfaces.Surface]  # upper, cap, sole or lace, which differ in color; and its posed surface


@dataclass(frozen=True)
class Upper:
    """The outer surface of an upper.

    Attributes:
        shape: (n,3) vertices on the rest pose, metres.
        weights: (n,B) skinning weights.
        faces: (m,3).
        ground: height of the ground, metres.
        toes, heel: z of both ends of the foot, metres.
    """

    shape: np.ndarray
    weights: np.ndarray
    faces: np.ndarray
    ground: float
    toes: float
    heel: float


def build_shoes(motion: Motion, shoe: Shoe) -> list[ShoePart]:
    """Builds both shoes in the pose, with the soles below the feet."""
    return [part for side in "LR" for part in build_shoe(motion, shoe, side)]


@dataclass(frozen=True)
class Footprint:
    """Where a bare foot stands in the rest pose: heights of ball and heel, and the length between them, metres."""

    ball: float
    heel: float
    length: float


def footprint(body: Body) -> Footprint:
    """Finds where the feet of a body, in its rest pose, stand; both are alike."""
    skin, (_, ankle, _), (_, _, ball) = body.skin, body.joints["foot.L"], body.joints[f"{TOES}.L"]
    foot = skin[(skin[:, 0] > 0) & (skin[:, 1] < ankle)]
    end = foot[:, 2].min()
    under_ball, under_heel = np.abs(foot[:, 2] - ball) < BALL_REACH, foot[:, 2] < end + HEEL_REACH
    return Footprint(float(foot[under_ball, 1].min()), float(foot[under_heel, 1].min()), float(ball - end))


def heel_pitch(body: Body, shoe: Shoe) -> float:
    """Returns the degrees by which a shoe pitches the foot, from its ball back; the toes stay level.

    Args:
        body: in its rest pose.
        shoe: its thickness under toes and heel.
    """
    stands = footprint(body)
    return float(np.degrees(np.arctan2(shoe.heel + stands.ball - shoe.sole - stands.heel, stands.length)))


def _rigid_weights(body: Body, side: str, z: np.ndarray) -> np.ndarray:
    """Returns the skinning weights (n,B) of points z (n,), metres, of a shoe, which bends at the ball of the foot."""
    bones = makehuman.rig().bones
    weights = np.zeros((len(z), len(bones)))
    weights[:, bones.index(f"{TOES}.{side}")] = np.clip((z - body.joints[f"{TOES}.{side}"][2]) / BEND + 0.5, 0, 1)
    weights[:, bones.index(f"foot.{side}")] = 1 - weights.sum(1)
    return weights


def upper(body: Body, shoe: Shoe, side: str) -> Upper:
    """Cuts the upper of a shoe from the foot of the suit.

    Args:
        body: in its rest pose.
        shoe: height of its upper, and how pointed it is.
        side: L | R.
    """
    suit, ankle = body.tights, body.joints[f"foot.{side}"]
    faces = makehuman.base().faces["helper-tights"] - makehuman.TIGHTS.start
    on_side = (suit[:, 0] > 0) == (side == "L")
    field = np.where(on_side & (suit[:, 1] < ankle[1] + 0.40), ankle[1] + shoe.top - suit[:, 1], -1.0)
    if shoe.top < -0.01:  # a low shoe is cut lower in front of the ankle than at the heel
        field = field - np.where(on_side, 0.35 * np.clip(0.03 - np.abs(suit[:, 2] - ankle[2] - 0.05), 0, 1), 0)
    matrix, faces = surfaces.clip(sparse.identity(len(suit), format="csr"), faces, field)
    for _ in range(2):
        subdivide, faces = surfaces.loop(faces, matrix.shape[0])
        matrix = subdivide @ matrix
    rest = matrix @ suit
    ground = footprint(body).ball - INSOLE
    toes, heel = rest[:, 2].max(), rest[:, 2].min()
    length = toes - heel
    outward = surfaces.smoothed(surfaces.normals(rest, faces), faces, 3)
    near_ground = np.clip(1 - (rest[:, 1] - ground) / 0.05, 0, 1)  # within 5 cm
    shape = rest + outward * (0.005 + 0.004 * near_ground)[:, None]  # 5 to 9 mm off the foot
    front = np.clip((shape[:, 2] - (toes - 0.32 * length)) / (0.32 * length), 0, 1)  # 0 to 1 over the front third
    middle = np.median(shape[front > 0.2, 0]) if (front > 0.2).any() else ankle[0]
    shape[:, 0] += (middle - shape[:, 0]) * shoe.point * 0.45 * front**2  # narrower ...
    shape[:, 2] += (0.012 + 0.02 * shoe.point) * front**2  # ... and longer at the toes
    shape[:, 1] = np.maximum(shape[:, 1], ground + 0.001)
    weights = matrix @ makehuman.rig().weights[makehuman.TIGHTS]
    rigid = np.clip((ankle[1] + 0.01 - shape[:, 1]) / 0.03, 0, 1)[:, None]  # 1 below the ankle
    weights = weights / weights.sum(1, keepdims=True) * (1 - rigid) + _rigid_weights(body, side, shape[:, 2]) * rigid
    return Upper(shape, weights, faces, ground=ground, toes=toes, heel=heel)


def build_shoe(motion: Motion, shoe: Shoe, side: str) -> list[ShoePart]:
    """Builds the shoe of a side ("L" | "R") in the pose: upper, toe cap, laces and sole."""
    outside, ankle = upper(motion.body, shoe, side), motion.body.joints[f"foot.{side}"]
    shape, weights, faces = outside.shape, outside.weights, outside.faces
    ground, toes, heel = outside.ground, outside.toes, outside.heel
    length = toes - heel
    parts: list[ShoePart] = []
    if shoe.straps:
        along = (shape[:, 2] - heel) / length  # 0 at the heel, 1 at the toes
        across_foot = np.max([np.minimum(along - start, end - along) for start, end in STRAPS], axis=0)
        from_ankle_strap = np.abs(shape[:, 1] - ankle[1] + 0.012 + 0.10 * along)  # metres; it slopes down to the front
        around_ankle = np.minimum(0.009 - from_ankle_strap, 0.40 - along)
        field = np.maximum(across_foot, 4 * around_ankle)  # positive on the straps
        matrix, cut = surfaces.clip(sparse.identity(len(shape), format="csr"), faces, field)
        posed = motion.skin(matrix @ weights, matrix @ shape)
        parts.append(("upper", surfaces.thickened(posed, cut, STRAP_THICKNESS, rings=None)[:2]))
    else:
        in_cap = np.zeros(len(faces), bool)
        if shoe.cap:
            cap_length = shoe.cap + 0.03 * np.clip((shape[:, 1] - ground) / 0.03, 0, 1)  # it reaches back higher up
            field = cap_length - (toes - shape[:, 2]) / length
            matrix, faces, in_cap = surfaces.split(sparse.identity(len(shape), format="csr"), faces, field)
            shape, weights = matrix @ shape, matrix @ weights
        posed = motion.skin(weights, shape)
        vertices, thick, _ = surfaces.thickened(posed, faces, UPPER_THICKNESS, rings=4)
        in_cap = np.r_[in_cap, np.zeros(len(thick) - len(faces), bool)]
        parts.append(("upper", (vertices, thick[~in_cap])))
        if shoe.cap:
            parts.append(("cap", (vertices, thick[in_cap])))
        if shoe.laces:
            outside = replace(outside, shape=shape, weights=weights, faces=faces)
            parts.append(("lace", laces(outside, motion, shoe.laces)))
    bottom = shape[shape[:, 1] < ground + 0.022]
    parts.append(("sole", sole(bottom, ground, shoe, motion, side)))
    return parts


def laces(outside: Upper, motion: Motion, count: int) -> surfaces.Surface:
    """Builds bands of laces across the instep and up the shaft, cut from the upper and moved off it.

    Args:
        outside: the upper.
        motion: how the body moves from its rest pose into the pose.
        count: number of bands.

    Returns:
        The laces, posed.
    """
    shape, faces, toes = outside.shape, outside.faces, outside.toes
    facing = surfaces.normals(shape, faces)
    # from the toes over the instep up the shaft, metres
    distance = toes - shape[:, 2] + 0.9 * (shape[:, 1] - outside.ground)
    first = 0.36 * (toes - outside.heel) + 0.03  # distance of the first band
    number = np.clip(np.round((distance - first) / LACE_STEP), 0, count - 1)  # of the nearest band
    from_band = np.abs(distance - first - number * LACE_STEP)
    middle = np.median(shape[np.abs(distance - first - 0.03) < 0.02, 0])
    within_ends = HALF_LACE - np.abs(shape[:, 0] - middle)
    faces_up = np.where(facing[:, 1] + facing[:, 2] > 0.35, 1.0, -1.0)  # or forward
    field = np.minimum(np.minimum(HALF_LACE_WIDTH - from_band, within_ends), faces_up)  # positive on the laces
    # Without `snap` no edge has more than two faces, though a few are slivers.
    matrix, cut = surfaces.clip(sparse.identity(len(shape), format="csr"), faces, field, snap=0)
    posed = motion.skin(matrix @ outside.weights, matrix @ shape + (matrix @ facing) * LACE_THICKNESS)
    return surfaces.thickened(posed, cut, LACE_THICKNESS, rings=2)[:2]


def sole(bottom: np.ndarray, ground: float, shoe: Shoe, motion: Motion, side: str) -> surfaces.Surface:
    """Builds a closed slab under the outline of the foot, whose heel is level where it pitches the foot.

    Args:
        bottom: (n,3) the lowest vertices of the upper on the rest pose, metres.
        ground: height of the bare foot's ground, metres.
        shoe: its thickness under toes and heel.
        motion: how the body moves from its rest pose into the pose.
        side: L | R.

    Returns:
        Posed vertices (V,3) and faces (F,3), outward.
    """
    flat = bottom[:, [0, 2]]  # seen from above
    hull = flat[ConvexHull(flat).vertices]  # counter-clockwise, so faces are outward
    hull = np.roll(hull, -np.argmin(hull[:, 1]), axis=0)  # from the heel on
    travel = np.r_[0, np.cumsum(np.linalg.norm(np.roll(hull, -1, 0) - hull, axis=1))]
    even = np.linspace(0, travel[-1], OUTLINE_POINTS, endpoint=False)
    ring = np.stack([np.interp(even, travel, np.r_[hull[:, c], hull[0, c]]) for c in (0, 1)], axis=1)
    ring = surfaces.smooth_line(ring, 6, closed=True)
    centre = ring.mean(0)
    outward = (ring - centre) / np.linalg.norm(ring - centre, axis=1, keepdims=True)
    along = (ring[:, 1] - ring[:, 1].min()) / np.ptp(ring[:, 1])  # 0 at the heel, 1 at the toes
    stands = footprint(motion.body)
    behind = (motion.body.joints[f"{TOES}.{side}"][2] - ring[:, 1]) / stands.length  # 0 at the ball, 1 at the heel
    thickness = shoe.sole + (shoe.heel - shoe.sole) * behind * np.clip((HEEL - along) / HEEL_BREAST, 0, 1)
    level = ground + (stands.heel - stands.ball) * np.maximum(behind, 0)  # height of the foot's ground, metres
    rows = []
    for grow, height in SOLE_ROWS:
        y = level + (height if height > 0 else 0) + thickness * min(height, 0)
        rows.append(np.stack([ring[:, 0] + outward[:, 0] * grow, y, ring[:, 1] + outward[:, 1] * grow], axis=1))
    n = len(ring)
    sides = surfaces.cut_cells(surfaces.ring_grid(len(rows), n), "abc", "bdc", by_row=True)
    # From the heel to the toes and from side to side, so that top and bottom bend across the foot.
    half = np.arange(1, n // 2)
    zigzag = np.r_[0, np.stack([half, n - half], axis=1).ravel(), n // 2]
    triangle = np.stack([zigzag[:-2], zigzag[1:-1], zigzag[2:]], axis=1)
    triangle[::2] = triangle[::2, ::-1]
    vertices, last = np.concatenate(rows), (len(rows) - 1) * n
    weights = _rigid_weights(motion.body, side, vertices[:, 2])
    return motion.skin(weights, vertices), np.concatenate([sides, triangle, last + triangle[:, ::-1]])
