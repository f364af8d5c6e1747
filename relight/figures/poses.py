"""Poses: a library of stances, solved into bone rotations for a given body, and the skinning that carries them out.

A bone's rotation is given in world-aligned axes relative to its parent, so a pose reads the same for every body. Arms
and legs are set by closed-form two-bone inverse kinematics from where the hands and feet go.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from relight.figures import makehuman
from relight.figures.body import Body


@dataclass(frozen=True)
class Hand:
    """Where a wrist goes: `wrist` (3,) in units of the arm's length from the shoulder, mirrored so that +x is outward,
    and the way the elbow points. palm: degrees of turn about the forearm."""

    wrist: tuple[float, float, float]
    elbow: tuple[float, float, float] = (0.6, -0.2, -1.0)
    palm: float = 0.0
    wrist_bend: float = 0.0


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
HIP = Hand((0.30, -0.66, 0.03), elbow=(1.0, -0.15, -0.55), palm=-30, wrist_bend=35)
POCKET = Hand((0.27, -0.80, 0.15), elbow=(0.8, -0.1, -0.7), palm=10)
BEHIND = Hand((0.04, -0.72, -0.33), elbow=(1.0, -0.2, -0.2), palm=40)
FOLDED = Hand((-0.22, -0.36, 0.40), elbow=(1.0, -0.75, 0.2), palm=-40)
CHIN = Hand((-0.22, -0.02, 0.44), elbow=(0.25, -1.0, 0.15), palm=-30)
WAVE = Hand((0.62, 0.42, 0.18), elbow=(0.7, -0.7, -0.1), palm=60)
RAISED = Hand((0.34, 0.86, 0.12), elbow=(1.0, 0.2, -0.4), palm=20)
WIDE = Hand((0.82, -0.42, 0.14), elbow=(0.0, -0.7, -0.8))
POINT = Hand((0.38, -0.06, 0.86), elbow=(0.7, -0.8, -0.1))
CARRY = Hand((0.10, -0.55, 0.48), elbow=(0.7, -0.6, -0.6), palm=-50)
KNEE = Hand((0.06, -0.62, 0.52), elbow=(0.9, -0.4, -0.4), palm=-10)
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


@dataclass(frozen=True)
class Motion:
    """Bone transforms (T,B,3,4) taking the rest pose to frames of the way into a pose; the last frame is the pose."""

    pose: str
    transforms: np.ndarray
    bones: dict[str, int]

    def skin(self, weights: np.ndarray, rest: np.ndarray, frame: int = -1) -> np.ndarray:
        """Linear blend skinning: weights (V,B), rest (V,3) -> (V,3) at a frame."""
        blend = (weights @ self.transforms[frame].reshape(len(self.bones), 12)).reshape(-1, 3, 4)
        return np.einsum("nij,nj->ni", blend[:, :, :3], rest) + blend[:, :, 3]


def arc(a: np.ndarray, b: np.ndarray) -> Rotation:
    """The smallest rotation that takes direction a to direction b."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return Rotation.identity()
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, a @ b))


def two_bones(root: np.ndarray, goal: np.ndarray, upper: float, lower: float, pole: np.ndarray) -> np.ndarray:
    """Where the middle joint goes so that bones of the two lengths reach `goal`, bending toward `pole`."""
    span = goal - root
    reach = min(np.linalg.norm(span), 0.998 * (upper + lower))
    axis = span / np.linalg.norm(span)
    along = (upper**2 - lower**2 + reach**2) / (2 * reach)
    side = pole - axis * (pole @ axis)
    return root + axis * along + side / np.linalg.norm(side) * np.sqrt(max(upper**2 - along**2, 0.0))


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
        for side, sign, hand, foot in (("L", 1, pose.left, pose.left_foot), ("R", -1, pose.right, pose.right_foot)):
            self.arm(side, sign, hand, pose.fingers)
            self.leg(side, sign, foot, leg)
        return self.local

    def limb(self, upper: str, lower: str, tip: str, goal: np.ndarray, pole: np.ndarray) -> None:
        j = self.joints
        rotation, root = self.placed(upper)
        before = rotation * self.local.get(upper, Rotation.identity()).inv()
        middle = two_bones(root, goal, np.linalg.norm(j[lower] - j[upper]), np.linalg.norm(j[tip] - j[lower]), pole)
        self.local[upper] = arc(j[lower] - j[upper], before.inv().apply(middle - root))
        rotation = before * self.local[upper]
        self.local[lower] = arc(j[tip] - j[lower], rotation.inv().apply(goal - middle))

    def arm(self, side: str, sign: int, hand: Hand, fingers: float) -> None:
        mirror = np.array([sign, 1, 1])
        j = self.joints
        length = np.linalg.norm(j[f"lowerarm01.{side}"] - j[f"upperarm01.{side}"]) + np.linalg.norm(
            j[f"wrist.{side}"] - j[f"lowerarm01.{side}"]
        )
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
        along = j[f"wrist.{side}"] - j[f"lowerarm01.{side}"]
        turn = Rotation.from_rotvec(np.radians(hand.palm) * sign * along / np.linalg.norm(along))
        self.local[f"lowerarm02.{side}"] = turn
        self.local[f"wrist.{side}"] = Rotation.from_euler("z", sign * hand.wrist_bend, degrees=True)
        across = np.cross(along, j[f"finger2-1.{side}"] - j[f"finger5-1.{side}"])
        hinge = np.cross(along, across)
        hinge /= np.linalg.norm(hinge)
        for finger in (2, 3, 4, 5):
            for part, share in ((1, 0.9), (2, 1.4), (3, 1.0)):
                angle = np.radians(fingers * share * (0.8 + 0.1 * finger))
                self.local[f"finger{finger}-{part}.{side}"] = Rotation.from_rotvec(hinge * angle)

    def leg(self, side: str, sign: int, foot: Foot, length: float) -> None:
        mirror = np.array([sign, 1, 1])
        j = self.joints
        step = np.array(foot.step) - [NARROW, 0, 0]
        goal = j[f"foot.{side}"] + step * mirror * length
        facing = Rotation.from_euler("y", sign * foot.turn, degrees=True)
        pole = facing.apply([0.05 * sign, 0.25, 1.0])
        self.limb(f"upperleg01.{side}", f"lowerleg01.{side}", f"foot.{side}", goal, pole)
        before, _ = self.placed(f"lowerleg02.{side}")
        self.local[f"foot.{side}"] = before.inv() * facing * Rotation.from_euler("x", foot.pitch, degrees=True)


def motion(body: Body, pose: Pose, frames: int) -> Motion:
    """`frames` + 1 frames from the rest pose to `pose`, starting and ending gently; the sole of the lowest foot ends at
    y = 0."""
    rig = makehuman.rig()
    solver = Solver(body)
    local = solver.solve(pose)
    vectors = np.stack([local[bone].as_rotvec() if bone in local else np.zeros(3) for bone in rig.bones])
    joints = np.stack([body.joints[bone] for bone in rig.bones])
    u = np.linspace(0, 1, frames + 1)
    transforms = np.empty((frames + 1, len(rig.bones), 3, 4))
    for t, a in enumerate(u * u * (3 - 2 * u)):
        turns = Rotation.from_rotvec(vectors * a).as_matrix()
        for b, parent in enumerate(rig.parent):
            up = transforms[t, parent] if parent >= 0 else np.c_[np.eye(3), solver.shift * a]
            transforms[t, b, :, :3] = up[:, :3] @ turns[b]
            transforms[t, b, :, 3] = up[:, :3] @ joints[b] + up[:, 3] - transforms[t, b, :, :3] @ joints[b]
    out = Motion(pose.name, transforms, {bone: i for i, bone in enumerate(rig.bones)})
    lowest = out.skin(rig.weights[makehuman.BODY], body.skin)[:, 1].min()
    out.transforms[..., 1, 3] -= lowest
    return out


def sample_pose(rng: np.random.Generator, sitting: float = 0.0) -> Pose:
    """A standing pose, or a sitting one with the given probability, possibly mirrored, then varied."""
    library = SITTING if rng.random() < sitting else STANDING
    return varied(library[rng.integers(len(library))], rng)


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
