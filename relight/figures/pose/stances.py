"""The library of poses, standing and sitting, and how one is drawn and varied."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Hand:
    """The goal of a hand. Directions are in the frame of the chest, mirrored so that +x is outward.

    Attributes:
        wrist: position relative to the shoulder, in arm lengths.
        elbow: direction in which the elbow points.
        palm: degrees of rotation about the forearm, where `along` is None.
        along: direction from the wrist to the fingers, within the limits of wrist and forearm, or None.
        facing: direction in which the palm faces, where `along` is given.
        curl: mean degrees by which fingers bend at each joint.
        rests: whether the hand lies on the body.
        holds: the prop in it: "" | phone | cup | bag.
    """

    wrist: Triple
    elbow: Triple = (0.6, -0.2, -1.0)
    palm: float = 0.0
    along: Triple | None = None
    facing: Triple = (-1.0, 0.0, 0.0)
    curl: float = 17.0
    rests: bool = False
    holds: str = ""


@dataclass(frozen=True)
class Foot:
    """The goal of a foot.

    Attributes:
        step: displacement of the ankle from the rest pose, in leg lengths (outward, up, forward).
        turn: degrees outward.
        pitch: degrees, toes down.
    """

    step: Triple = (0.0, 0.0, 0.0)
    turn: float = 8.0
    pitch: float = 0.0


class Trunk(TypedDict):
    """Arguments of `Pose` that poses with the same trunk share."""

    spine: Triple
    hips: Triple
    shift: Triple


@dataclass(frozen=True)
class Pose:
    """A pose of a body. Angles are in degrees about x (forward), y (to the figure's left) and z.

    Attributes:
        name: as `relight figures --names` lists it.
        left, right: goals of the hands.
        feet: goals of the left and the right foot.
        spine: rotation of the trunk, distributed over its bones.
        hips: rotation of the pelvis.
        head: rotation of the head in the world.
        shift: of the pelvis, in leg lengths.
        sitting: whether the figure sits.
        turn: of the whole figure about the vertical, toward its left.
    """

    name: str
    left: Hand
    right: Hand
    feet: tuple[Foot, Foot] = (Foot(), Foot())
    spine: Triple = (0.0, 0.0, 0.0)
    hips: Triple = (0.0, 0.0, 0.0)
    head: Triple = (0.0, 0.0, 0.0)
    shift: Triple = (0.0, 0.0, 0.0)
    sitting: bool = False
    turn: float = 0.0


NARROWER = 0.05  # how much closer to the middle each foot is than on the rest pose, in leg lengths
CLOSER_FEET = (0.04, 0.09)  # the same in addition, for half of the poses with level feet
TURN_SPREAD = 25.0  # degrees, standard deviation
TURNED_SHARE = 0.4  # of the poses

DOWN = Hand((0.22, -0.95, 0.06))
DOWN_LOOSE = Hand((0.36, -0.88, 0.12))
DOWN_BACK = Hand((0.26, -0.93, -0.12))
HIP = Hand((0.06, -0.66, -0.10), (1.0, -0.15, -0.55), along=(-0.25, -0.45, 0.85), curl=9, rests=True)
POCKET = Hand((0.08, -0.80, 0.10), (0.8, -0.1, -0.7), along=(-0.15, -1.0, 0.25), curl=9, rests=True)
BACK_POCKET = Hand(
    (0.04, -0.74, -0.32), (1.0, -0.1, -0.6), along=(-0.3, -1.0, 0.1), facing=(0, 0, 1), curl=9, rests=True
)
BEHIND = Hand((-0.12, -0.74, -0.38), (1.0, -0.2, -0.2), along=(-0.7, -0.7, -0.1), facing=(0, 0.1, -1))
BEHIND_OVER = replace(BEHIND, wrist=(-0.08, -0.67, -0.44))
FOLDED = Hand((-0.46, -0.50, 0.36), (1.0, -0.75, 0.2), along=(-1, 0.1, -0.3), facing=(0, -0.2, -1), curl=14)
FOLDED_OVER = Hand((-0.46, -0.37, 0.56), (1.0, -0.75, 0.2), along=(-1, 0.15, -0.45), facing=(0, -0.2, -1), curl=14)
CLASPED = Hand((-0.26, -0.78, 0.34), (0.9, -0.3, -0.5), along=(-0.7, -0.7, 0.1), facing=(0, 0, -1), curl=20)
CLASPED_OVER = replace(CLASPED, wrist=(-0.22, -0.74, 0.43))
HEART = Hand((-0.20, -0.36, 0.34), (1.0, -0.7, 0.0), along=(-0.85, 0.45, -0.15), facing=(0, 0, -1), curl=6, rests=True)
CHIN = Hand((-0.22, -0.04, 0.46), (0.25, -1.0, 0.15), along=(-0.25, 0.95, -0.2), facing=(-0.4, 0.1, -1), curl=48)
WAVE = Hand((0.62, 0.42, 0.18), (0.7, -0.7, -0.1), along=(0.25, 0.95, 0.1), facing=(0, 0, 1), curl=6)
GREETING = Hand((0.42, -0.10, 0.42), (0.7, -0.9, -0.2), along=(0.15, 1, 0.15), facing=(0, 0, 1), curl=6)
RAISED = Hand((0.34, 0.86, 0.12), (1.0, 0.2, -0.4), along=(0.1, 1, 0), facing=(-0.3, 0, 1))
WIDE = Hand((0.82, -0.42, 0.14), (0.0, -0.7, -0.8), along=(0.85, -0.45, 0.1), facing=(0, 0.2, 1), curl=10)
ASIDE = Hand((0.92, -0.16, 0.14), (0.0, -0.7, -0.8), along=(0.95, -0.1, 0.1), facing=(0, -1, 0.3), curl=10)
POINT = Hand((0.38, -0.06, 0.86), (0.7, -0.8, -0.1), along=(0.3, 0.05, 0.95), facing=(-0.2, -1, 0), curl=24)
OPEN = Hand((0.40, -0.50, 0.46), (0.4, -0.7, -0.7), along=(0.45, 0.15, 0.9), facing=(-0.2, 1, 0.1), curl=12)
FIST = Hand((-0.06, -0.18, 0.50), (0.5, -1.0, 0.1), along=(-0.2, 0.75, 0.5), facing=(-0.6, 0.2, -0.8), curl=62)
CARRY = Hand((0.10, -0.55, 0.48), (0.7, -0.6, -0.6), along=(-0.2, 0.1, 1), facing=(-0.4, 0.9, 0))
PHONE = Hand(
    (-0.04, -0.38, 0.50), (0.5, -1, -0.3), along=(-0.4, 0.6, 0.6), facing=(-0.4, 0.4, -0.8), curl=22, holds="phone"
)
CUP = Hand((0.04, -0.46, 0.46), (0.6, -0.9, -0.4), along=(-0.4, 0.1, 0.9), facing=(-0.9, 0, -0.4), curl=18, holds="cup")
BAG = Hand((0.34, -0.93, 0.02), along=(0.05, -1, 0.1), curl=55, holds="bag")
KNEE = Hand((-0.04, -0.78, 0.52), (0.9, -0.4, -0.4), along=(-0.1, -0.15, 1), facing=(-0.1, -1, 0), curl=10, rests=True)
WIDE_KNEE = replace(KNEE, wrist=(0.20, -0.72, 0.50))
LAP = Hand((-0.18, -0.80, 0.44), (0.9, -0.4, -0.5), along=(-0.8, -0.1, 0.45), facing=(0, -1, -0.2), curl=12, rests=True)
SWING_FORWARD = Hand((0.16, -0.86, 0.40), (0.5, -0.3, -1.0))
SWING_BACK = Hand((0.26, -0.88, -0.28), (0.5, -0.3, -1.0))
SEAT = (0.0, -0.46, -0.05)

LEVEL = (Foot(), Foot())
OUTWARD = (Foot((0.05, 0, 0)), Foot((0.05, 0, 0)))
ASTRIDE = (Foot((0.14, 0, 0), 16), Foot((0.14, 0, 0), 16))
LEFT_FREE = (Foot((0.06, 0, 0.10), 22), Foot((-0.05, 0, 0)))
RIGHT_FREE = (Foot((-0.04, 0, 0)), Foot((0.07, 0, 0.08), 20))
STEP = (Foot((0.02, 0, 0.12)), Foot((0.0, 0, -0.02), 14))
STRIDE = (Foot((-0.03, 0.0, 0.26), 4, -8), Foot((-0.03, 0.06, -0.26), 4, 28))
BACK_STRIDE = (Foot((-0.02, 0.05, -0.2), 6, 24), Foot((-0.02, 0.0, 0.2), 6))
SEATED = (Foot((0.0, 0, 0.44), 6), Foot((0.0, 0, 0.44), 6))
ON_RIGHT: Trunk = {"spine": (1, 6, -4), "hips": (0, -4, 5), "shift": (-0.03, -0.012, 0)}  # the weight on the right leg
ON_LEFT: Trunk = {"spine": (0, -4, 4), "hips": (0, 3, -5), "shift": (0.03, -0.012, 0)}
WALKING: Trunk = {"spine": (3, 6, 0), "hips": (0, -8, 0), "shift": (0, -0.035, 0.0)}

STANDING = (
    Pose("relaxed", DOWN_LOOSE, DOWN_LOOSE),
    Pose("straight", DOWN, DOWN, (Foot(turn=4), Foot(turn=4))),
    Pose("at ease", DOWN, DOWN_BACK, STEP, head=(2, 10, 0)),
    Pose("contrapposto", DOWN_LOOSE, DOWN, LEFT_FREE, **ON_RIGHT, head=(3, 12, -3)),
    Pose("contrapposto, head turned", DOWN, DOWN_LOOSE, RIGHT_FREE, **ON_LEFT, head=(2, -24, 3)),
    Pose("hands on hips", HIP, HIP, OUTWARD, head=(2, -10, 0)),
    Pose("hands on hips, astride", HIP, HIP, ASTRIDE, (-3, 0, 0), head=(-4, 4, 0), shift=(0, -0.02, 0)),
    Pose("one hand on hip", HIP, DOWN_LOOSE, RIGHT_FREE, **ON_LEFT, head=(0, 10, 4)),
    Pose("hand on hip, stepping", DOWN, HIP, STEP, (0, 6, 0), (0, -4, 0), (0, -12, 3)),
    Pose("hands in pockets", POCKET, POCKET, (Foot((0.03, 0, 0.03)), Foot((0.01, 0, 0))), (2, 0, 0), head=(6, 8, 0)),
    Pose("hands in pockets, weight on one leg", POCKET, POCKET, LEFT_FREE, **ON_RIGHT, head=(0, -12, 2)),
    Pose("hand in pocket", DOWN_LOOSE, POCKET, LEFT_FREE, **ON_RIGHT, head=(0, -14, 2)),
    Pose("hand in pocket, walking", SWING_BACK, POCKET, STRIDE, **WALKING, head=(0, 6, 0)),
    Pose("hands in back pockets", BACK_POCKET, BACK_POCKET, LEVEL, (-3, 0, 0), head=(0, 12, 0)),
    Pose("hands behind", BEHIND, BEHIND_OVER, head=(0, 6, 0)),
    Pose("hands behind, astride", BEHIND_OVER, BEHIND, ASTRIDE, head=(0, -4, 0), shift=(0, -0.02, 0)),
    Pose("arms crossed", FOLDED, FOLDED_OVER, OUTWARD, (-2, 0, 0), head=(-2, -8, 0)),
    Pose("arms crossed, weight on one leg", FOLDED_OVER, FOLDED, LEFT_FREE, **ON_RIGHT, head=(2, 14, -3)),
    Pose("arm across", FOLDED, DOWN, RIGHT_FREE, **ON_LEFT, head=(6, -8, 0)),
    Pose("hand at chin", CHIN, FOLDED, head=(6, 6, 4)),
    Pose("hand on heart", HEART, DOWN, head=(4, 4, 0)),
    Pose("hands clasped", CLASPED, CLASPED_OVER, head=(3, 4, 0)),
    Pose("hands clasped, stepping", CLASPED_OVER, CLASPED, STEP, (0, 4, 0), head=(4, -12, 2)),
    Pose("waving", WAVE, DOWN_LOOSE, spine=(0, 0, -3), head=(0, 10, -4)),
    Pose("greeting", GREETING, DOWN, STEP, head=(0, 6, -2)),
    Pose("greeting, hand in pocket", GREETING, POCKET, **ON_LEFT, head=(2, 10, -4)),
    Pose("arms raised", RAISED, RAISED, (Foot((0.07, 0, 0)), Foot((0.07, 0, 0))), (-3, 0, 0), head=(-6, 0, 0)),
    Pose("one arm raised", RAISED, DOWN_LOOSE, OUTWARD, (0, 0, -4), head=(-10, 12, 0)),
    Pose("arms wide", WIDE, WIDE, OUTWARD, head=(-3, 0, 0)),
    Pose("one arm aside", ASIDE, DOWN, OUTWARD, (0, 4, 0), head=(0, 24, 0)),
    Pose("open hands", OPEN, OPEN, STEP, (2, 0, 0), head=(4, -4, 0)),
    Pose("one open hand", OPEN, HIP, RIGHT_FREE, **ON_LEFT, head=(2, 16, 4)),
    Pose("fists", FIST, replace(FIST, wrist=(-0.02, -0.28, 0.40)), STEP, (6, 10, 0), (0, 6, 0), (2, 6, 0)),
    Pose("pointing", POINT, DOWN, STEP, (0, -8, 0), (0, -4, 0), (0, 8, 0)),
    Pose("carrying", CARRY, CARRY, spine=(-3, 0, 0), head=(10, 0, 0)),
    Pose("walking", SWING_BACK, SWING_FORWARD, STRIDE, **WALKING, head=(0, 4, 0)),
    Pose("stepping", SWING_FORWARD, SWING_BACK, BACK_STRIDE, (3, -6, 0), (0, 7, 0), (0, -10, 0), (0, -0.025, 0)),
    Pose(
        "knee bent",
        DOWN_LOOSE,
        HIP,
        (Foot((0.04, 0.03, 0.12), 26, 18), Foot((-0.05, 0, 0))),
        (0, 5, -3),
        (0, -4, 5),
        (0, 14, 0),
        (-0.04, -0.01, 0),
    ),
    Pose("wide stance", DOWN_LOOSE, DOWN_LOOSE, ASTRIDE, shift=(0, -0.025, 0)),
    Pose(
        "trunk turned",
        DOWN_LOOSE,
        DOWN_LOOSE,
        (Foot((0.02, 0, 0.06), 30), Foot((0, 0, -0.04), -8)),
        (0, 18, 0),
        (0, 16, 0),
        (0, 18, 0),
    ),
    Pose("over the shoulder", DOWN, DOWN_BACK, LEVEL, (0, -20, 0), (0, -8, 0), (2, -40, 0)),
    Pose("looking aside", DOWN, POCKET, LEFT_FREE, (0, -8, 2), (0, -6, 2), (2, -32, 0)),
    Pose("looking up", DOWN_LOOSE, DOWN, STEP, (-4, 0, 0), head=(-22, 10, 0)),
    Pose("looking down", DOWN, DOWN_LOOSE, STEP, (4, 0, 0), head=(26, -12, 0)),
    Pose(
        "leaning forward",
        Hand((0.2, -0.86, 0.34)),
        Hand((0.2, -0.86, 0.3)),
        (Foot((0.04, 0, 0)), Foot((0.04, 0, 0))),
        (16, 0, 0),
        (6, 0, 0),
        (-8, 0, 0),
        (0, -0.01, -0.03),
    ),
    Pose("leaning aside", HIP, DOWN, OUTWARD, (0, 0, -9), head=(0, 4, 6)),
    Pose("with a phone", PHONE, DOWN, LEFT_FREE, (3, 0, 0), head=(20, 8, 0)),
    Pose("with a phone, hand in pocket", PHONE, POCKET, RIGHT_FREE, **ON_LEFT, head=(18, 10, 2)),
    Pose("with a phone, arm across", PHONE, FOLDED, head=(16, 6, 0)),
    Pose("with a cup", CUP, DOWN_LOOSE, LEFT_FREE, **ON_RIGHT, head=(2, 10, 0)),
    Pose("with a cup, hand on hip", CUP, HIP, RIGHT_FREE, **ON_LEFT, head=(0, -12, 2)),
    Pose("with a cup and a phone", CUP, PHONE, STEP, head=(16, -8, 0)),
    Pose("with a bag", BAG, DOWN, STEP, (0, 0, -2), head=(0, -8, 0)),
    Pose("with a bag and a phone", BAG, PHONE, LEFT_FREE, (3, 0, 0), head=(18, -8, 0)),
    Pose("with a bag, walking", replace(BAG, wrist=(0.34, -0.9, 0.12)), SWING_BACK, BACK_STRIDE, (3, -4, 0), (0, 5, 0)),
)
SITTING = (
    Pose("sitting", KNEE, KNEE, SEATED, (4, 0, 0), head=(0, 6, 0), shift=SEAT, sitting=True),
    Pose(
        "sitting wide",
        WIDE_KNEE,
        WIDE_KNEE,
        (Foot((0.14, 0, 0.42), 16), Foot((0.14, 0, 0.40), 16)),
        (10, 4, 0),
        (2, 0, 0),
        (-4, -8, 0),
        SEAT,
        True,
    ),
    Pose(
        "sitting back",
        Hand((0.3, -0.8, 0.2)),
        KNEE,
        (Foot((0.03, 0, 0.56), 10), Foot((0.04, 0, 0.40), 8)),
        (-8, -4, 0),
        (-6, 0, 0),
        (6, 10, 0),
        SEAT,
        True,
    ),
    Pose(
        "sitting, hands in the lap",
        LAP,
        replace(LAP, wrist=(-0.16, -0.76, 0.44)),
        SEATED,
        (2, 0, 0),
        shift=SEAT,
        sitting=True,
    ),
    Pose("sitting with a phone", PHONE, KNEE, SEATED, (8, 0, 0), head=(18, 4, 0), shift=SEAT, sitting=True),
)


def sample_pose(rng: np.random.Generator, sitting: float = 0.0, names: Collection[str] = ()) -> Pose:
    """Draws a pose and varies it, mirrored half of the time.

    Args:
        rng: random generator.
        sitting: probability of a sitting pose; without effect if all poses to draw from stand, or all sit.
        names: of the poses to draw from; empty for all.
    """
    library = [pose for pose in (*STANDING, *SITTING) if not names or pose.name in names]
    sits = rng.random() < sitting
    drawn = [pose for pose in library if pose.sitting == sits] or library
    return varied(drawn[rng.integers(len(drawn))], rng)


def varied(pose: Pose, rng: np.random.Generator) -> Pose:
    """Returns a variant of a pose: random angles and wrists, at times mirrored, turned, or with the feet closer."""

    def near(values: Triple, spread: float) -> Triple:
        x, y, z = np.array(values) + rng.normal(0, spread, 3)
        return float(x), float(y), float(z)

    def mirrored(angles: Triple) -> Triple:
        return angles[0], -angles[1], -angles[2]

    if rng.random() < 0.5:
        across, up, ahead = pose.shift
        pose = replace(
            pose, left=pose.right, right=pose.left, feet=(pose.feet[1], pose.feet[0]),
            spine=mirrored(pose.spine), hips=mirrored(pose.hips), head=mirrored(pose.head),
            shift=(-float(across), up, ahead),
        )  # fmt: skip
    left, right = (replace(hand, wrist=near(hand.wrist, 0.015)) for hand in (pose.left, pose.right))
    pose = replace(
        pose, left=left, right=right, spine=near(pose.spine, 1.5), hips=near(pose.hips, 1.0), head=near(pose.head, 4.0)
    )
    closer, turn = float(rng.uniform(*CLOSER_FEET)), float(rng.normal(0, TURN_SPREAD))
    if rng.random() < 0.5 and not pose.sitting and all(foot.step[0] <= 0.07 and not foot.step[1] for foot in pose.feet):
        left_foot, right_foot = (
            replace(foot, step=(foot.step[0] - closer, foot.step[1], foot.step[2])) for foot in pose.feet
        )
        pose = replace(pose, feet=(left_foot, right_foot))
    return replace(pose, turn=turn if rng.random() < TURNED_SHARE else 0.0)
