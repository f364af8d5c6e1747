"""The library of poses, standing and sitting, and how one is drawn and varied."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from relight.figures.catalogue.schema import entries

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Hand:
    """The goal of a hand. Directions are in the frame of the chest, mirrored so that +x is outward.

    Attributes:
        wrist: position relative to the shoulder, in arm lengths.
        elbow: direction in which the elbow points.
        along: direction from the wrist to the fingers, within the limits of wrist and forearm, or None.
        facing: direction in which the palm faces, where `along` is given.
        curl: mean degrees by which fingers bend at each joint.
        rests: whether the hand lies on the body.
        holds: the prop in it, or nothing.
    """

    wrist: Triple
    elbow: Triple = (0.6, -0.2, -1.0)
    along: Triple | None = None
    facing: Triple = (-1.0, 0.0, 0.0)
    curl: float = 17.0
    rests: bool = False
    holds: Literal["", "phone", "cup", "bag"] = ""


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


@dataclass(frozen=True)
class Pose:
    """A pose of a body. Angles are in degrees about x (forward), y (to the figure's left) and z.

    Attributes:
        name: as `relight figures --names` lists it.
        left, right: goals of the hands.
        feet: goals of the left and the right foot.
        spine: rotation of the trunk, distributed over its bones.
        hips: rotation of the pelvis.
        head: rotation of the head, to which the trunk's yaw and half of its pitch are added.
        shift: displacement of the pelvis, in leg lengths.
        sitting: whether the figure sits.
        turn: degrees by which the whole figure is turned about the vertical, toward its left.
        heels: degrees by which the heels of shoes pitch both feet, toes level; added to the pitch of each foot.
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
    heels: float = 0.0


NARROWER = 0.05  # how much closer to the middle each foot is than on the rest pose, in leg lengths
CLOSER_FEET = (0.04, 0.09)  # the same in addition, for half of the poses with level feet
MAX_OUTWARD = 0.07  # outward steps of feet that are put closer, leg lengths
TURN_SPREAD = 25.0  # degrees, standard deviation
TURNED_SHARE = 0.4  # of the poses


def poses() -> dict[str, Pose]:
    """Returns all poses by name, those that stand before those that sit."""
    return entries("poses", "standing", Pose) | entries("poses", "sitting", Pose)


def sample_pose(rng: np.random.Generator, sitting: float = 0.0, names: Collection[str] = ()) -> Pose:
    """Draws a pose and varies it, mirrored half of the time.

    Args:
        rng: random generator.
        sitting: probability of a sitting pose; without effect if all poses to draw from stand, or all sit.
        names: names of the poses to draw from; empty for all.
    """
    library = [pose for pose in poses().values() if not names or pose.name in names]
    sits = rng.random() < sitting
    drawn = [pose for pose in library if pose.sitting == sits] or library
    return varied(drawn[rng.integers(len(drawn))], rng)


def varied(pose: Pose, rng: np.random.Generator) -> Pose:
    """Returns a variant of a pose: random angles and wrists, at times mirrored, turned, or with the feet closer."""

    def near(values: Triple, spread: float) -> Triple:
        """Draws values around the given ones, with a standard deviation."""
        x, y, z = np.array(values) + rng.normal(0, spread, 3)
        return float(x), float(y), float(z)

    def mirrored(angles: Triple) -> Triple:
        return angles[0], -angles[1], -angles[2]

    if rng.random() < 0.5:  # hands and feet are given outward from their side, so they only change sides
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
    are_level = (outward <= MAX_OUTWARD and up == 0 for outward, up, _ in (foot.step for foot in pose.feet))
    if rng.random() < 0.5 and not pose.sitting and all(are_level):
        left_foot, right_foot = (
            replace(foot, step=(foot.step[0] - closer, foot.step[1], foot.step[2])) for foot in pose.feet
        )
        pose = replace(pose, feet=(left_foot, right_foot))
    return replace(pose, turn=turn if rng.random() < TURNED_SHARE else 0.0)
