"""Poses: stances solved into bone rotations for a given body, and the skinning that carries them out.

A bone's rotation is given in world-aligned axes relative to its parent, so a pose reads the same for every body. Arms
and legs are set by closed-form two-bone inverse kinematics from where the hands and feet go.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.stances import NARROW, Foot, Hand, Pose

MOST_BENT = np.radians(65)  # of a wrist
MOST_TWISTED = np.radians(95)  # of a forearm
CLOSER = (0.75, 0.45)  # shares of the angles between fingers, and of the thumb's, that a hand at ease takes back


@dataclass(frozen=True)
class Motion:
    """Bone transforms (T,B,3,4) taking the rest pose to frames of the way into a pose; the last frame is the pose."""

    pose: str
    transforms: np.ndarray
    bones: dict[str, int]

    def skin(self, weights: np.ndarray, rest: np.ndarray, frame: int = -1) -> np.ndarray:
        """Linear blend skinning: weights (V,B), rest (V,3) -> (V,3) at a frame."""
        return skinned(weights, rest, self.transforms[frame])


def skinned(weights: np.ndarray, rest: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """Linear blend skinning: weights (V,B), rest (V,3), bone transforms (B,3,4) -> (V,3)."""
    blend = (weights @ transforms.reshape(-1, 12)).reshape(-1, 3, 4)
    return np.einsum("nij,nj->ni", blend[:, :, :3], rest) + blend[:, :, 3]


def arc(a: np.ndarray, b: np.ndarray) -> Rotation:
    """The smallest rotation that takes direction a to direction b."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return Rotation.identity()
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, a @ b))


def two_bones(
    root: np.ndarray, goal: np.ndarray, upper: float | np.floating, lower: float | np.floating, pole: np.ndarray
) -> np.ndarray:
    """Where the middle joint goes so that bones of the two lengths reach `goal`, bending toward `pole`."""
    span = goal - root
    reach = np.minimum(np.linalg.norm(span), 0.998 * (upper + lower))
    axis = span / np.linalg.norm(span)
    along = (upper**2 - lower**2 + reach**2) / (2 * reach)
    side = pole - axis * (pole @ axis)
    return root + axis * along + side / np.linalg.norm(side) * np.sqrt(max(upper**2 - along**2, 0.0))


def unit(vector: np.ndarray) -> np.ndarray:
    """The vector scaled to length 1."""
    return vector / np.linalg.norm(vector)


def frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The orthonormal matrix (3,3) whose columns are `first`, what of `second` is square to it, and their product."""
    x = unit(first)
    y = unit(second - x * (second @ x))
    return np.stack([x, y, np.cross(x, y)], axis=1)


def twist_and_swing(rotation: Rotation, axis: np.ndarray) -> tuple[float, Rotation]:
    """Splits a rotation into a swing followed by a twist, an angle in (-pi, pi] about a unit axis."""
    x, y, z, w = rotation.as_quat()
    angle = 2 * np.arctan2(np.array([x, y, z]) @ axis, w)
    angle = float((angle + np.pi) % (2 * np.pi) - np.pi)
    return angle, Rotation.from_rotvec(-angle * axis) * rotation


def angle_about(axis: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """The angle, radians, from one direction to another as seen along a unit axis."""
    return float(np.arctan2(axis @ np.cross(first, second), first @ second - (axis @ first) * (axis @ second)))


class Solver:
    """Turns a Pose into local rotations (rotation vectors, world-aligned) of one body's bones."""

    def __init__(self, body: Body):
        self.joints, self.rig = body.joints, makehuman.rig()
        self.local: dict[str, Rotation] = {}
        self.shift = np.zeros(3)

    def placed(self, bone: str) -> tuple[Rotation, np.ndarray]:
        """World rotation and joint position of a bone under the rotations set so far."""
        chain = [bone]
        index = {name: i for i, name in enumerate(self.rig.bones)}
        while self.rig.parent[index[chain[0]]] >= 0:
            chain.insert(0, self.rig.bones[self.rig.parent[index[chain[0]]]])
        rotation, position = Rotation.identity(), self.joints[chain[0]] + self.shift
        for parent, child in zip([None, *chain], chain):
            if parent:
                position = position + rotation.apply(self.joints[child] - self.joints[parent])
            rotation = rotation * self.local.get(child, Rotation.identity())
        return rotation, position

    def solve(self, pose: Pose) -> dict[str, Rotation]:
        """The local rotations of all bones that a pose moves, by name."""
        leg = self.joints["upperleg01.L"][1] - self.joints["foot.L"][1]
        self.shift = np.array(pose.shift) * leg
        self.local["root"] = Rotation.from_euler("yxz", [pose.hips[1], pose.hips[0], pose.hips[2]], degrees=True)
        lean, twist, tilt = pose.spine
        for bone in ("spine05", "spine04", "spine03", "spine02", "spine01"):
            self.local[bone] = Rotation.from_euler("yxz", np.array([twist, lean, tilt]) / 5, degrees=True)
        # the head's turn is given in the world: what the hips and the spine turned is taken back by the neck
        head = np.array([pose.head[1], pose.head[0] - 0.5 * (lean + pose.hips[0]), pose.head[2] - tilt - pose.hips[2]])
        for bone, share in (("neck01", 0.25), ("neck02", 0.25), ("head", 0.5)):
            self.local[bone] = Rotation.from_euler("yxz", head * share, degrees=True)
        for side, sign, hand, foot in (("L", 1, pose.left, pose.feet[0]), ("R", -1, pose.right, pose.feet[1])):
            self.arm(side, sign, hand)
            self.leg(side, sign, foot, leg)
        return self.local

    def limb(self, upper: str, lower: str, tip: str, goal: np.ndarray, pole: np.ndarray) -> None:
        """Bends two bones so that `tip` comes to `goal` (3,), with the joint between them toward `pole` (3,)."""
        j = self.joints
        rotation, root = self.placed(upper)
        before = rotation * self.local.get(upper, Rotation.identity()).inv()
        middle = two_bones(root, goal, np.linalg.norm(j[lower] - j[upper]), np.linalg.norm(j[tip] - j[lower]), pole)
        self.local[upper] = arc(j[lower] - j[upper], before.inv().apply(middle - root))
        rotation = before * self.local[upper]
        self.local[lower] = arc(j[tip] - j[lower], rotation.inv().apply(goal - middle))

    def arm_length(self, side: str) -> float:
        """Metres from shoulder to wrist, stretched."""
        j = self.joints
        upper = np.linalg.norm(j[f"lowerarm01.{side}"] - j[f"upperarm01.{side}"])
        return float(upper + np.linalg.norm(j[f"wrist.{side}"] - j[f"lowerarm01.{side}"]))

    def arm(self, side: str, sign: int, hand: Hand) -> None:
        """Sets the arm of a side ("L" | "R"; sign 1 | -1), from collar bone to wrist."""
        mirror = np.array([sign, 1, 1])
        length = self.arm_length(side)
        raised = np.clip(hand.wrist[1] + 0.25, 0, 1)  # the collar bone helps an arm that goes up
        self.local[f"clavicle.{side}"] = Rotation.from_euler("z", sign * (18 * raised - 3), degrees=True)
        trunk, _ = self.placed("spine01")
        _, shoulder = self.placed(f"upperarm01.{side}")
        reach = np.array(hand.wrist)
        reach = reach / max(1.0, np.linalg.norm(reach) / 0.985)
        goal = shoulder + trunk.apply(reach * mirror * length)
        self.limb(
            f"upperarm01.{side}",
            f"lowerarm01.{side}",
            f"wrist.{side}",
            goal,
            trunk.apply(np.array(hand.elbow) * mirror),
        )
        self.hand(side, mirror, hand, trunk)

    def hand(self, side: str, mirror: np.ndarray, hand: Hand, trunk: Rotation) -> None:
        """Turns forearm and wrist as far as they go toward the way that the hand points and faces, and curls fingers.

        Args:
            side: L | R.
            mirror: (3,) signs that take outward to +x or -x.
            hand: its `along`, `facing`, `palm`, `curl`.
            trunk: world rotation of the chest, in whose frame the hand's directions are.
        """
        j = self.joints
        forearm = unit(j[f"wrist.{side}"] - j[f"lowerarm01.{side}"])
        across = np.cross(forearm, j[f"finger2-1.{side}"] - j[f"finger5-1.{side}"])
        hinge = mirror[0] * unit(np.cross(forearm, across))  # fingers curl about it; a mirror turns axes round
        palm = np.cross(hinge, forearm)
        twist, bend = mirror[0] * np.radians(hand.palm), Rotation.identity()
        if hand.along is not None:
            rest = frame(j[f"finger3-1.{side}"] - j[f"wrist.{side}"], palm)
            goal = frame(*(trunk.apply(np.array(way) * mirror) for way in (hand.along, hand.facing)))
            arm, _ = self.placed(f"lowerarm01.{side}")
            twist, bend = twist_and_swing(arm.inv() * Rotation.from_matrix(goal @ rest.T), forearm)
            bend = Rotation.from_rotvec(bend.as_rotvec() * min(1.0, MOST_BENT / max(bend.magnitude(), 1e-9)))
        self.local[f"lowerarm02.{side}"] = Rotation.from_rotvec(np.clip(twist, -MOST_TWISTED, MOST_TWISTED) * forearm)
        self.local[f"wrist.{side}"] = bend
        middle = j[f"finger3-2.{side}"] - j[f"finger3-1.{side}"]
        for finger in (1, 2, 3, 4, 5):
            first, second = (f"finger{finger}-{part}.{side}" for part in (1, 2))
            apart = angle_about(palm, middle, j[second] - j[first])
            share = CLOSER[finger == 1] * (not (hand.holds and finger == 1))  # the thumb of a hand that holds is apart
            closer = Rotation.from_rotvec(-share * apart * palm)
            for part, share in ((1, 0.9), (2, 1.4), (3, 1.0)):
                curl = np.radians(hand.curl * share * (0.8 + 0.1 * finger) * (finger > 1))
                bent = Rotation.from_rotvec(hinge * curl)
                self.local[f"finger{finger}-{part}.{side}"] = bent * closer if part == 1 else bent

    def leg(self, side: str, sign: int, foot: Foot, length: float) -> None:
        """Sets the leg of a side ("L" | "R"; sign 1 | -1), whose length is in metres."""
        mirror = np.array([sign, 1, 1])
        j = self.joints
        step = np.array(foot.step) - [NARROW, 0, 0]
        goal = j[f"foot.{side}"] + step * mirror * length
        facing = Rotation.from_euler("y", sign * foot.turn, degrees=True)
        pole = facing.apply([0.05 * sign, 0.25, 1.0])
        self.limb(f"upperleg01.{side}", f"lowerleg01.{side}", f"foot.{side}", goal, pole)
        before, _ = self.placed(f"lowerleg02.{side}")
        self.local[f"foot.{side}"] = before.inv() * facing * Rotation.from_euler("x", foot.pitch, degrees=True)


def rotation_vectors(local: dict[str, Rotation]) -> np.ndarray:
    """Of all bones (B,3), zero for those that are not turned."""
    return np.stack([local[bone].as_rotvec() if bone in local else np.zeros(3) for bone in makehuman.rig().bones])


def carried(body: Body, vectors: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Bone transforms (B,3,4) from the rest pose under rotation vectors (B,3) of the bones and a shift (3,) of all."""
    rig = makehuman.rig()
    joints = np.stack([body.joints[bone] for bone in rig.bones])
    turns = Rotation.from_rotvec(vectors).as_matrix()
    out = np.empty((len(rig.bones), 3, 4))
    for b, parent in enumerate(rig.parent):
        up = out[parent] if parent >= 0 else np.c_[np.eye(3), shift]
        out[b, :, :3] = up[:, :3] @ turns[b]
        out[b, :, 3] = up[:, :3] @ joints[b] + up[:, 3] - out[b, :, :3] @ joints[b]
    return out


def motion(body: Body, pose: Pose, frames: int) -> Motion:
    """`frames` + 1 frames from the rest pose to `pose`, starting and ending gently; the sole of the lowest foot ends at
    y = 0."""
    rig = makehuman.rig()
    solver = Solver(body)
    local = solver.solve(pose)
    vectors = rotation_vectors(local)
    u = np.linspace(0, 1, frames + 1)
    transforms = np.stack([carried(body, vectors * a, solver.shift * a) for a in u * u * (3 - 2 * u)])
    lowest = skinned(rig.weights[makehuman.BODY], body.skin, transforms[-1])[:, 1].min()
    transforms[..., 1, 3] -= lowest
    turned = Rotation.from_euler("y", pose.turn, degrees=True).as_matrix() @ transforms  # from the first frame on
    return Motion(pose.name, turned, {bone: i for i, bone in enumerate(rig.bones)})
