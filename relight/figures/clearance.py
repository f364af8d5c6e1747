"""Moves the wrists of a pose until the hands have room for the clothes."""

from dataclasses import replace

import numpy as np

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.colliders import Collider
from relight.figures.garments import Garment
from relight.figures.layers import sided
from relight.figures.poses import Solver, carried, rotation_vectors, skinned
from relight.figures.stances import Pose

LAYER = 0.005  # metres that each garment adds
MOST = 0.05  # metres by which a wrist moves at once
REACH = 0.2  # metres within which the body is looked for
ROUNDS = 4


def room(garments: list[Garment], sitting: bool) -> tuple[float, float]:
    """How much room the clothes take up.

    Args:
        garments: all that is worn.
        sitting: whether the figure sits; then tops do not reach the lap.

    Returns:
        Metres at the hips and thighs, and metres at the chest.
    """
    cut = [g for g in garments if g.kind != "scarf"]
    tops = [g for g in cut if g.kind == "top"]
    hips = [max(g.legs[2:5]) for g in cut if g.kind == "trousers"] + [
        0.02 + 0.03 * g.flare for g in cut if g.drop > 0.2
    ]
    if not sitting:
        hips += [max(g.torso[:2]) for g in tops]
    return max(hips, default=0.01) + LAYER * len(cut), max((g.torso[3] for g in tops), default=0.0) + LAYER * len(tops)


def shares(*names: str) -> np.ndarray:
    """The share (V,) of each skin vertex's skinning weights that belongs to bones whose names begin so."""
    rig = makehuman.rig()
    return rig.weights[makehuman.BODY][:, [i for i, bone in enumerate(rig.bones) if bone.startswith(names)]].sum(1)


def cleared(body: Body, pose: Pose, needed: tuple[float, float]) -> Pose:
    """Moves the wrists of a pose until the hands clear the clothes.

    Args:
        body: in its rest pose.
        pose: the pose.
        needed: metres between the hands and the trunk or legs, at the hips and at the chest.

    Returns:
        The pose with its wrists moved outward, as far as the arms reach. A hand that rests on the body moves inward,
        too; a hand at the face stays there.
    """
    weights, faces = makehuman.rig().weights[makehuman.BODY], makehuman.base().faces["body"]
    hand = shares("finger", "metacarpal", "wrist") > 0.5
    trunk = shares("root", "pelvis", "spine", "breast", "upperleg", "lowerleg") > 0.5
    solid = faces[trunk[faces].all(1)]
    for _ in range(ROUNDS):
        solver = Solver(body)
        turns = carried(body, rotation_vectors(solver.solve(pose)), solver.shift)
        skin = skinned(weights, body.skin, turns)
        surface = Collider(skin, skin, solid)
        turn, chest = solver.placed("spine01")
        moved = {}
        for side, sign in (("left", 1), ("right", -1)):
            points = skin[hand & (np.sign(body.skin[:, 0]) == sign)]
            face, distance, normal = sided(points, surface, REACH)
            low = solver.placed("root")[1][1]
            lacking = np.where(face >= 0, np.interp(points[:, 1], [low, chest[1]], needed) - distance, -REACH)
            own = getattr(pose, side)
            deficit = float(np.clip(np.percentile(lacking, 95), -MOST if own.rests else 0, MOST))
            if abs(deficit) < 0.002 or (face < 0).all():
                continue
            worst = lacking >= np.percentile(lacking, 80)
            out = normal[worst].mean(0)
            out /= max(np.linalg.norm(out), 1e-6)
            step = turn.inv().apply(deficit * out) * [sign, 1, 1] / solver.arm_length("L" if sign > 0 else "R")
            moved[side] = replace(own, wrist=tuple(map(float, np.array(own.wrist) + step)))
        if not moved:
            break
        pose = replace(pose, **moved)
    return pose
