"""The motion of a body from its rest pose into a pose, and skinning: how its vertices follow the bones."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from relight.figures.body import makehuman
from relight.figures.body.kinematics import PoseSolver
from relight.figures.body.shape import Body
from relight.figures.draw.poses import Pose
from relight.figures.texture import smoothstep


@dataclass(frozen=True)
class Motion:
    """How a body moves from its rest pose into a pose.

    Attributes:
        body: in its rest pose.
        transforms: (T,B,3,4) bone transforms from the rest pose to each frame; the last frame is the pose.
        bones: indices of the bones by name.
    """

    body: Body
    transforms: np.ndarray
    bones: dict[str, int]

    def skin(self, weights: np.ndarray, rest: np.ndarray, frame: int = -1) -> np.ndarray:
        """Returns vertices (V,3) on the rest pose, `rest`, moved to a frame, the pose by default (`skinned`)."""
        return skinned(weights, rest, self.transforms[frame])

    @cached_property
    def posed_skin(self) -> np.ndarray:
        """The vertices (n,3) of the skin in the pose, metres."""
        return self.skin(makehuman.rig().weights[makehuman.BODY], self.body.skin)

    def bone(self, name: str) -> np.ndarray:
        """Returns the transform (3,4) of a bone from the rest pose into the pose."""
        return self.transforms[-1, self.bones[name]]

    def joint(self, name: str) -> np.ndarray:
        """Returns the joint (3,) of a bone in the pose, metres."""
        bone = self.bone(name)
        return bone[:, :3] @ self.body.joints[name] + bone[:, 3]


def skinned(weights: np.ndarray, rest: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """Returns vertices (V,3) at `rest` moved by linear blend skinning.

    `weights` (V,B) are the shares of the bones, and `transforms` (B,3,4) take points from the rest pose to the pose.
    """
    blend = (weights @ transforms.reshape(-1, 12)).reshape(-1, 3, 4)
    return np.einsum("nij,nj->ni", blend[:, :, :3], rest) + blend[:, :, 3]


def rotation_vectors(local: dict[str, Rotation]) -> np.ndarray:
    """Returns the rotation vectors (B,3), radians, of all bones in the rig's order; 0 for those without a rotation."""
    return np.stack([local[bone].as_rotvec() if bone in local else np.zeros(3) for bone in makehuman.rig().bones])


def bone_transforms(body: Body, vectors: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Computes how bones move from the rest pose (forward kinematics).

    Args:
        body: in its rest pose.
        vectors: (B,3) rotation vectors of the bones relative to their parents, radians.
        shift: (3,) of the root, metres.

    Returns:
        (B,3,4) transforms from the rest pose.
    """
    rig = makehuman.rig()
    joints = np.stack([body.joints[bone] for bone in rig.bones])
    rotations = Rotation.from_rotvec(vectors).as_matrix()
    transforms = np.empty((len(rig.bones), 3, 4))
    for b, parent in enumerate(rig.parent):  # parents come before children
        parent_transform = transforms[parent] if parent >= 0 else np.c_[np.eye(3), shift]
        transforms[b, :, :3] = parent_transform[:, :3] @ rotations[b]
        joint = parent_transform[:, :3] @ joints[b] + parent_transform[:, 3]  # about which the bone rotates
        transforms[b, :, 3] = joint - transforms[b, :, :3] @ joints[b]
    return transforms


def build_motion(body: Body, pose: Pose, frames: int) -> Motion:
    """Interpolates from the rest pose to a pose, slowly at both ends.

    Args:
        body: in its rest pose.
        pose: in which the motion ends.
        frames: number of steps; there is one frame more.

    Returns:
        The motion, at whose end the lowest vertex of the skin is at y = 0.
    """
    rig = makehuman.rig()
    solver = PoseSolver(body)
    vectors = rotation_vectors(solver.solve(pose))
    shares = smoothstep(np.linspace(0, 1, frames + 1))
    transforms = np.stack([bone_transforms(body, vectors * share, solver.shift * share) for share in shares])
    lowest = skinned(rig.weights[makehuman.BODY], body.skin, transforms[-1])[:, 1].min()
    transforms[..., 1, 3] -= lowest
    turned = Rotation.from_euler("y", pose.turn, degrees=True).as_matrix() @ transforms
    return Motion(body, turned, {bone: i for i, bone in enumerate(rig.bones)})
