"""Moves the wrists of a pose until the hands have room for the clothes."""

from dataclasses import replace

import numpy as np

from relight.figures.body import makehuman
from relight.figures.body.kinematics import PoseSolver
from relight.figures.body.motion import bone_transforms, rotation_vectors, skinned
from relight.figures.body.shape import Body
from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.draw.poses import Pose

MAX_STEP = 0.05  # largest move of a wrist per round, metres
RANGE = 0.2  # search range of the body, metres
ROUNDS = 4
TOLERANCE = 0.002  # metres


def clear_hands(body: Body, pose: Pose, needed: tuple[float, float]) -> Pose:
    """Moves the wrists of a pose until the hands clear the clothes.

    Args:
        body: in its rest pose.
        pose: the pose.
        needed: metres between the hands and the trunk or legs, at the hips and at the chest.

    Returns:
        The pose with its wrists moved outward, as far as the arms reach. A hand that rests on the body moves inward,
        too; one farther than RANGE from trunk and legs, such as a hand at the face, stays.
    """
    weights, faces = makehuman.rig().weights[makehuman.BODY], makehuman.base().faces["body"]
    hands = makehuman.bone_weights("finger", "metacarpal", "wrist") > 0.5
    trunk = makehuman.bone_weights("root", "pelvis", "spine", "breast", "upperleg", "lowerleg") > 0.5
    trunk_faces = faces[trunk[faces].all(1)]
    for _ in range(ROUNDS):
        solver = PoseSolver(body)
        transforms = bone_transforms(body, rotation_vectors(solver.solve(pose)), solver.shift)
        skin = skinned(weights, body.skin, transforms)
        surface = Collider.at_rest(skin, trunk_faces)
        chest_rotation, chest = solver.world_transform("spine01")
        hips = solver.world_transform("root")[1]
        moved = {}
        for side, sign in (("left", 1), ("right", -1)):
            points = skin[hands & (np.sign(body.skin[:, 0]) == sign)]
            nearest_face, distance, normal = signed_distance(points, surface, RANGE)
            required = np.interp(points[:, 1], [hips[1], chest[1]], needed)
            missing = np.where(nearest_face >= 0, required - distance, -RANGE)
            hand = getattr(pose, side)
            # Room that is missing, or to spare where negative. Percentiles, since a single vertex may be wrong.
            deficit = float(np.clip(np.percentile(missing, 95), -MAX_STEP if hand.rests else 0, MAX_STEP))
            if abs(deficit) < TOLERANCE or (nearest_face < 0).all():
                continue
            outward = normal[missing >= np.percentile(missing, 80)].mean(0)
            outward /= max(np.linalg.norm(outward), 1e-6)
            # The frame of `Hand.wrist`: that of the chest, mirrored, in arm lengths.
            step = chest_rotation.inv().apply(deficit * outward) * [sign, 1, 1]
            step = step / solver.arm_length("L" if sign > 0 else "R")
            moved[side] = replace(hand, wrist=tuple(map(float, np.array(hand.wrist) + step)))
        if not moved:
            break
        pose = replace(pose, **moved)
    return pose
