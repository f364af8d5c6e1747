"""The library of stances, standing and sitting, and how one is drawn and varied."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Hand:
    """Where a wrist goes: `wrist` (3,) in units of the arm's length from the shoulder, mirrored so that +x is outward,
    and the way the elbow points. palm: degrees of turn about the forearm; rests: whether the hand lies on the body."""

    wrist: tuple[float, float, float]
    elbow: tuple[float, float, float] = (0.6, -0.2, -1.0)
    palm: float = 0.0
    wrist_bend: float = 0.0
    rests: bool = False


@dataclass(frozen=True)
class Foot:
    """Where an ankle goes from its rest place, in leg lengths (outward, up, forward), and the foot's turn outward
    and its pitch (toes down), degrees."""

    step: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: float = 8.0
    pitch: float = 0.0


@dataclass(frozen=True)
class Pose:
    """A stance. lean, twist, tilt: degrees of the trunk about x (forward), y (to its left), z, shared by the spine;
    hips: the same for the pelvis; head likewise; drop: how far the pelvis sinks, in leg lengths."""

    name: str
    left: Hand
    right: Hand
    left_foot: Foot = Foot()
    right_foot: Foot = Foot()
    spine: tuple[float, float, float] = (0.0, 0.0, 0.0)
    hips: tuple[float, float, float] = (0.0, 0.0, 0.0)
    head: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fingers: float = 14.0
    sitting: bool = False


DOWN = Hand((0.24, -0.95, 0.06))
DOWN_LOOSE = Hand((0.36, -0.88, 0.12))
HIP = Hand((0.30, -0.66, 0.03), elbow=(1.0, -0.15, -0.55), palm=-30, wrist_bend=35, rests=True)
POCKET = Hand((0.27, -0.80, 0.15), elbow=(0.8, -0.1, -0.7), palm=10, rests=True)
BEHIND = Hand((0.04, -0.72, -0.33), elbow=(1.0, -0.2, -0.2), palm=40)
FOLDED = Hand((-0.22, -0.36, 0.40), elbow=(1.0, -0.75, 0.2), palm=-40)
CHIN = Hand((-0.22, -0.02, 0.44), elbow=(0.25, -1.0, 0.15), palm=-30)
WAVE = Hand((0.62, 0.42, 0.18), elbow=(0.7, -0.7, -0.1), palm=60)
RAISED = Hand((0.34, 0.86, 0.12), elbow=(1.0, 0.2, -0.4), palm=20)
WIDE = Hand((0.82, -0.42, 0.14), elbow=(0.0, -0.7, -0.8))
POINT = Hand((0.38, -0.06, 0.86), elbow=(0.7, -0.8, -0.1))
CARRY = Hand((0.10, -0.55, 0.48), elbow=(0.7, -0.6, -0.6), palm=-50)
KNEE = Hand((0.06, -0.62, 0.52), elbow=(0.9, -0.4, -0.4), palm=-10, rests=True)
SWING_FORWARD = Hand((0.16, -0.86, 0.40), elbow=(0.5, -0.3, -1.0))
SWING_BACK = Hand((0.26, -0.88, -0.28), elbow=(0.5, -0.3, -1.0))
NARROW = 0.05  # the rest pose stands with its legs apart: by this much of their length closer
SEAT = (0.0, -0.46, -0.05)

STANDING = (
    Pose("relaxed", DOWN_LOOSE, DOWN_LOOSE),
    Pose("straight", DOWN, DOWN, Foot(turn=4), Foot(turn=4)),
    Pose(
        "contrapposto",
        DOWN_LOOSE,
        DOWN,
        Foot((0.06, 0, 0.10), 22),
        Foot((-0.05, 0, 0)),
        (1, 6, -4),
        (0, -4, 5),
        (3, 12, -3),
        (-0.03, -0.012, 0),
    ),
    Pose("hands on hips", HIP, HIP, Foot((0.05, 0, 0)), Foot((0.05, 0, 0)), head=(2, -10, 0)),
    Pose(
        "one hand on hip",
        HIP,
        DOWN_LOOSE,
        Foot((-0.04, 0, 0)),
        Foot((0.07, 0, 0.08), 20),
        (0, -4, 4),
        (0, 3, -5),
        (0, 10, 4),
        (0.03, -0.012, 0),
    ),
    Pose("hands in pockets", POCKET, POCKET, Foot((0.03, 0, 0.03)), Foot((0.01, 0, 0)), (2, 0, 0), head=(6, 8, 0)),
    Pose(
        "hand in pocket",
        DOWN_LOOSE,
        POCKET,
        Foot((0.05, 0, 0.06), 18),
        Foot(),
        (0, 4, -3),
        (0, -3, 3),
        (0, -14, 2),
        (-0.02, -0.01, 0),
    ),
    Pose("hands behind", BEHIND, BEHIND, head=(0, 6, 0)),
    Pose(
        "arms crossed",
        FOLDED,
        Hand((-0.20, -0.42, 0.46), (1.0, -0.75, 0.2), -30),
        Foot((0.04, 0, 0)),
        Foot((0.03, 0, 0)),
        (-2, 0, 0),
        head=(-2, -8, 0),
    ),
    Pose("hand at chin", CHIN, Hand((-0.26, -0.44, 0.36), (1.0, -0.6, 0.1), -40), head=(6, 6, 4)),
    Pose("waving", WAVE, DOWN_LOOSE, spine=(0, 0, -3), head=(0, 10, -4)),
    Pose("arms raised", RAISED, RAISED, Foot((0.07, 0, 0)), Foot((0.07, 0, 0)), (-3, 0, 0), head=(-6, 0, 0)),
    Pose("arms wide", WIDE, WIDE, Foot((0.06, 0, 0)), Foot((0.06, 0, 0)), head=(-3, 0, 0)),
    Pose("pointing", POINT, DOWN, Foot((0.02, 0, 0.12)), Foot(turn=14), (0, -8, 0), (0, -4, 0), (0, 8, 0)),
    Pose("carrying", CARRY, CARRY, spine=(-3, 0, 0), head=(10, 0, 0)),
    Pose(
        "walking",
        SWING_BACK,
        SWING_FORWARD,
        Foot((-0.03, 0.0, 0.26), 4, -8),
        Foot((-0.03, 0.06, -0.26), 4, 28),
        (3, 6, 0),
        (0, -8, 0),
        (0, 4, 0),
        (0, -0.035, 0.0),
    ),
    Pose(
        "stepping",
        SWING_FORWARD,
        SWING_BACK,
        Foot((-0.02, 0.05, -0.2), 6, 24),
        Foot((-0.02, 0.0, 0.2), 6),
        (3, -6, 0),
        (0, 7, 0),
        (0, -10, 0),
        (0, -0.025, 0.0),
    ),
    Pose(
        "knee bent",
        DOWN_LOOSE,
        HIP,
        Foot((0.04, 0.03, 0.12), 26, 18),
        Foot((-0.05, 0, 0)),
        (0, 5, -3),
        (0, -4, 5),
        (0, 14, 0),
        (-0.04, -0.01, 0),
    ),
    Pose("wide stance", DOWN_LOOSE, DOWN_LOOSE, Foot((0.16, 0, 0), 16), Foot((0.16, 0, 0), 16), shift=(0, -0.025, 0)),
    Pose(
        "turned",
        DOWN_LOOSE,
        DOWN_LOOSE,
        Foot((0.02, 0, 0.06), 30),
        Foot((0.0, 0, -0.04), -8),
        (0, 18, 0),
        (0, 16, 0),
        (0, 18, 0),
    ),
    Pose("looking aside", DOWN, POCKET, Foot((0.05, 0, 0.05), 20), Foot(), (0, -8, 2), (0, -6, 2), (2, -32, 0)),
    Pose(
        "leaning forward",
        Hand((0.2, -0.86, 0.34)),
        Hand((0.2, -0.86, 0.3)),
        Foot((0.04, 0, 0)),
        Foot((0.04, 0, 0)),
        (16, 0, 0),
        (6, 0, 0),
        (-8, 0, 0),
        (0, -0.01, -0.03),
    ),
)
SITTING = (
    Pose(
        "sitting",
        KNEE,
        KNEE,
        Foot((0.05, 0, 0.44), 6),
        Foot((0.05, 0, 0.44), 6),
        (4, 0, 0),
        (0, 0, 0),
        (0, 6, 0),
        SEAT,
        sitting=True,
    ),
    Pose(
        "sitting wide",
        KNEE,
        KNEE,
        Foot((0.14, 0, 0.42), 16),
        Foot((0.14, 0, 0.40), 16),
        (10, 4, 0),
        (2, 0, 0),
        (-4, -8, 0),
        SEAT,
        sitting=True,
    ),
    Pose(
        "sitting back",
        Hand((0.3, -0.8, 0.2)),
        KNEE,
        Foot((0.03, 0, 0.56), 10),
        Foot((0.04, 0, 0.40), 8),
        (-8, -4, 0),
        (-6, 0, 0),
        (6, 10, 0),
        SEAT,
        sitting=True,
    ),
)


def sample_pose(rng: np.random.Generator, sitting: float = 0.0, names: Collection[str] = ()) -> Pose:
    """Draws a pose and varies it, mirrored half of the time.

    Args:
        rng: the source of chance.
        sitting: probability of a pose that sits.
        names: of the poses to draw from; all where it is empty. Where all of them stand, or all sit, so does the pose.
    """
    library = [pose for pose in (*STANDING, *SITTING) if not names or pose.name in names]
    sits = rng.random() < sitting
    drawn = [pose for pose in library if pose.sitting == sits] or library
    return varied(drawn[rng.integers(len(drawn))], rng)


def varied(pose: Pose, rng: np.random.Generator) -> Pose:
    """The same pose as another person would take it: mirrored half of the time, and a little different."""

    def near(values: tuple, spread: float) -> tuple:
        return tuple(float(v) for v in np.array(values) + rng.normal(0, spread, 3))

    if rng.random() < 0.5:
        flip = np.array([1, -1, -1])
        pose = replace(
            pose, left=pose.right, right=pose.left, left_foot=pose.right_foot, right_foot=pose.left_foot,
            spine=tuple(pose.spine * flip), hips=tuple(pose.hips * flip), head=tuple(pose.head * flip),
            shift=tuple(pose.shift * np.array([-1, 1, 1])),
        )  # fmt: skip
    left, right = (replace(hand, wrist=near(hand.wrist, 0.015)) for hand in (pose.left, pose.right))
    return replace(
        pose, left=left, right=right, spine=near(pose.spine, 1.5), hips=near(pose.hips, 1.0), head=near(pose.head, 4.0)
    )
