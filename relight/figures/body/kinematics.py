"""Solves poses into bone rotations of a body by inverse kinematics.

A bone's rotation is given in world-aligned axes relative to its parent, so a pose reads the same for every body. Arms
and legs are set by closed-form two-bone inverse kinematics from the positions of hands and feet.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from relight.figures.body import makehuman
from relight.figures.body.shape import Body
from relight.figures.draw.poses import NARROWER, Foot, Hand, Pose

SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")  # bones, from the pelvis up
MAX_WRIST_BEND = np.radians(65)
MAX_FOREARM_TWIST = np.radians(95)
MAX_REACH = 0.985  # share of the arm's length at which a hand may be, so that the elbow never locks
STRETCHED = 0.998  # the same for any limb whose goal is too far away
FINGERS_CLOSED = 0.75  # share of the rest pose's angles between fingers that a relaxed hand closes
THUMB_CLOSED = 0.45  # the same for the thumb


def rotation_between(a: np.ndarray, b: np.ndarray) -> Rotation:
    """Returns the smallest rotation that takes direction a (3,) to direction b (3,)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    return Rotation.identity() if sine < 1e-9 else Rotation.from_rotvec(axis / sine * np.arctan2(sine, a @ b))


def middle_joint(
    root: np.ndarray, goal: np.ndarray, upper: float | np.floating, lower: float | np.floating, pole: np.ndarray
) -> np.ndarray:
    """Returns the joint (3,) between two bones, by inverse kinematics.

    `root` (3,) is the joint of the first one, `goal` (3,) is for the tip of the second one; their lengths are `upper`
    and `lower`, and the limb bends in the direction `pole` (3,).
    """
    span = goal - root
    reach = np.minimum(np.linalg.norm(span), STRETCHED * (upper + lower))
    axis = span / np.linalg.norm(span)
    along = (upper**2 - lower**2 + reach**2) / (2 * reach)  # law of cosines: of the joint, on the line to the goal
    side = pole - axis * (pole @ axis)
    return root + axis * along + side / np.linalg.norm(side) * np.sqrt(max(upper**2 - along**2, 0.0))


def unit(vector: np.ndarray) -> np.ndarray:
    """Returns the vector scaled to length 1."""
    return vector / np.linalg.norm(vector)


def orthonormal_frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Returns an orthonormal matrix (3,3): two directions after Gram-Schmidt, and their cross product, as columns."""
    x = unit(first)
    y = unit(second - x * (second @ x))
    return np.stack([x, y, np.cross(x, y)], axis=1)


def twist_and_swing(rotation: Rotation, axis: np.ndarray) -> tuple[float, Rotation]:
    """Splits a rotation into a swing followed by a twist about a unit axis (3,).

    Returns:
        The angle of the twist, in (-pi, pi], and the swing.
    """
    x, y, z, w = rotation.as_quat()
    angle = 2 * np.arctan2(np.array([x, y, z]) @ axis, w)
    angle = float((angle + np.pi) % (2 * np.pi) - np.pi)
    return angle, Rotation.from_rotvec(-angle * axis) * rotation


def angle_about(axis: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Returns the angle, radians in [-pi, pi], by which a direction (3,) turns about a unit axis (3,) to another one.

    Their parts along the axis do not count.
    """
    return float(np.arctan2(axis @ np.cross(first, second), first @ second - (axis @ first) * (axis @ second)))


class PoseSolver:
    """Solves a pose into rotations of one body's bones.

    Attributes:
        joints: (3,) of the body in its rest pose, metres, by bone.
        rig: MakeHuman's skeleton.
        local: rotations relative to the parent bone, in world-aligned axes, by bone.
        shift: (3,) of the root, metres.
    """

    def __init__(self, body: Body):
        self.joints, self.rig = body.joints, makehuman.rig()
        self.local: dict[str, Rotation] = {}
        self.shift = np.zeros(3)

    def world_transform(self, bone: str) -> tuple[Rotation, np.ndarray]:
        """Returns the world rotation of a bone and its joint (3,), metres, under the rotations set so far."""
        number = self.rig.parent[self.rig.bones.index(bone)]
        rotation, position = Rotation.identity(), self.joints[bone] + self.shift
        if number >= 0:
            parent = self.rig.bones[number]
            rotation, at = self.world_transform(parent)
            position = at + rotation.apply(self.joints[bone] - self.joints[parent])
        return rotation * self.local.get(bone, Rotation.identity()), position

    def solve(self, pose: Pose) -> dict[str, Rotation]:
        """Sets and returns the rotations of all bones that a pose moves, relative to their parents, by name.

        Trunk and head come first: the goals of hands and feet are reached from where they put the shoulders and hips.
        """
        leg = self.joints["upperleg01.L"][1] - self.joints["foot.L"][1]
        self.shift = np.array(pose.shift) * leg
        self.local["root"] = Rotation.from_euler("yxz", [pose.hips[1], pose.hips[0], pose.hips[2]], degrees=True)
        lean, twist, tilt = pose.spine
        for bone in SPINE:
            self.local[bone] = Rotation.from_euler("yxz", np.array([twist, lean, tilt]) / len(SPINE), degrees=True)
        # the pose gives the head's rotation in the world, so the neck undoes that of hips and spine
        head = np.array([pose.head[1], pose.head[0] - 0.5 * (lean + pose.hips[0]), pose.head[2] - tilt - pose.hips[2]])
        for bone, share in (("neck01", 0.25), ("neck02", 0.25), ("head", 0.5)):
            self.local[bone] = Rotation.from_euler("yxz", head * share, degrees=True)
        for side, sign, hand, foot in (("L", 1, pose.left, pose.feet[0]), ("R", -1, pose.right, pose.feet[1])):
            self._arm(side, sign, hand)
            self._leg(side, sign, foot, leg, pose.heels)
        return self.local

    def _limb(self, upper: str, lower: str, tip: str, goal: np.ndarray, pole: np.ndarray) -> None:
        """Rotates two bones so that the joint of `tip`, at which the lower one ends, is at a goal (3,), metres.

        The joint between the bones points in the direction `pole` (3,).
        """
        upper_bone, lower_bone = self.joints[lower] - self.joints[upper], self.joints[tip] - self.joints[lower]
        rotation, root = self.world_transform(upper)
        parent = rotation * self.local.get(upper, Rotation.identity()).inv()
        middle = middle_joint(root, goal, np.linalg.norm(upper_bone), np.linalg.norm(lower_bone), pole)
        self.local[upper] = rotation_between(upper_bone, parent.inv().apply(middle - root))
        rotation = parent * self.local[upper]
        self.local[lower] = rotation_between(lower_bone, rotation.inv().apply(goal - middle))

    def arm_length(self, side: str) -> float:
        """Returns the metres from shoulder to wrist of a stretched arm."""
        j = self.joints
        upper = np.linalg.norm(j[f"lowerarm01.{side}"] - j[f"upperarm01.{side}"])
        return float(upper + np.linalg.norm(j[f"wrist.{side}"] - j[f"lowerarm01.{side}"]))

    def _arm(self, side: str, sign: int, hand: Hand) -> None:
        """Rotates the arm of a side, "L" or "R" where x has the sign 1 or -1, from collar bone to fingers."""
        mirror = np.array([sign, 1, 1])
        raised = np.clip(hand.wrist[1] + 0.25, 0, 1)  # the collar bone helps an arm that goes up: from -3 to 15 degrees
        self.local[f"clavicle.{side}"] = Rotation.from_euler("z", sign * (18 * raised - 3), degrees=True)
        trunk, _ = self.world_transform("spine01")
        _, shoulder = self.world_transform(f"upperarm01.{side}")
        reach = np.array(hand.wrist)
        reach = reach / max(1.0, np.linalg.norm(reach) / MAX_REACH)
        goal = shoulder + trunk.apply(reach * mirror * self.arm_length(side))
        elbow_direction = trunk.apply(np.array(hand.elbow) * mirror)
        self._limb(f"upperarm01.{side}", f"lowerarm01.{side}", f"wrist.{side}", goal, elbow_direction)
        self._hand(side, mirror, hand, trunk)

    def _hand(self, side: str, mirror: np.ndarray, hand: Hand, trunk: Rotation) -> None:
        """Rotates forearm and wrist, within their limits, to the directions of the hand, and curls its fingers.

        The signs `mirror` (3,) take outward to +x or -x. The directions are in the frame of the chest, `trunk`.
        """
        j = self.joints
        forearm = unit(j[f"wrist.{side}"] - j[f"lowerarm01.{side}"])
        across = np.cross(forearm, j[f"finger2-1.{side}"] - j[f"finger5-1.{side}"])
        hinge = mirror[0] * unit(np.cross(forearm, across))  # axis of the curl; mirroring reverses rotation axes
        palm = np.cross(hinge, forearm)
        twist, bend = 0.0, Rotation.identity()
        if hand.along is not None:
            rest = orthonormal_frame(j[f"finger3-1.{side}"] - j[f"wrist.{side}"], palm)
            along, facing = (trunk.apply(np.array(direction) * mirror) for direction in (hand.along, hand.facing))
            goal = orthonormal_frame(along, facing)
            arm, _ = self.world_transform(f"lowerarm01.{side}")
            twist, bend = twist_and_swing(arm.inv() * Rotation.from_matrix(goal @ rest.T), forearm)
            bend = Rotation.from_rotvec(bend.as_rotvec() * min(1.0, MAX_WRIST_BEND / max(bend.magnitude(), 1e-9)))
        limited_twist = np.clip(twist, -MAX_FOREARM_TWIST, MAX_FOREARM_TWIST)
        self.local[f"lowerarm02.{side}"] = Rotation.from_rotvec(limited_twist * forearm)
        self.local[f"wrist.{side}"] = bend
        self._fingers(side, hand, palm, hinge)

    def _fingers(self, side: str, hand: Hand, palm: np.ndarray, hinge: np.ndarray) -> None:
        """Closes the gaps between the fingers, about the normal `palm` (3,), and curls them about `hinge` (3,).

        The thumb, finger 1, is not curled, and stays apart where the hand holds something.
        """
        j = self.joints
        middle_finger = j[f"finger3-2.{side}"] - j[f"finger3-1.{side}"]
        for finger in (1, 2, 3, 4, 5):
            knuckle, second = (f"finger{finger}-{part}.{side}" for part in (1, 2))
            apart = angle_about(palm, middle_finger, j[second] - j[knuckle])
            closed = THUMB_CLOSED if finger == 1 else FINGERS_CLOSED
            if hand.holds and finger == 1:
                closed = 0.0
            closing = Rotation.from_rotvec(-closed * apart * palm)
            for part, share in ((1, 0.9), (2, 1.4), (3, 1.0)):  # a finger bends most at its second joint
                curl = np.radians(hand.curl * share * (0.8 + 0.1 * finger) * (finger > 1))
                bent = Rotation.from_rotvec(hinge * curl)
                self.local[f"finger{finger}-{part}.{side}"] = bent * closing if part == 1 else bent

    def _leg(self, side: str, sign: int, foot: Foot, length: float, heels: float) -> None:
        """Rotates the leg of a side, with a length from hip to ankle in metres, down to the toes.

        On tiptoe the toes stay level. A shoe pitches the foot further, by `heels` degrees, but not the toes.
        """
        mirror = np.array([sign, 1, 1])
        goal = self.joints[f"foot.{side}"] + (np.array(foot.step) - [NARROWER, 0, 0]) * mirror * length
        facing = Rotation.from_euler("y", sign * foot.turn, degrees=True)
        pole = facing.apply([0.05 * sign, 0.25, 1.0])
        self._limb(f"upperleg01.{side}", f"lowerleg01.{side}", f"foot.{side}", goal, pole)
        shin, _ = self.world_transform(f"lowerleg02.{side}")
        self.local[f"foot.{side}"] = shin.inv() * facing * Rotation.from_euler("x", foot.pitch + heels, degrees=True)
        for toe in (1, 2, 3, 4, 5):
            self.local[f"toe{toe}-1.{side}"] = Rotation.from_euler("x", -heels - max(foot.pitch, 0), degrees=True)
