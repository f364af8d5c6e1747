"""Footwear: closed parts on the ground under the feet, caps, laces and straps where a shoe has them."""

from dataclasses import replace

import numpy as np
import pytest

from relight.figures.body.motion import build_motion
from relight.figures.body.shape import build_body
from relight.figures.cut import footwear
from relight.figures.drape.colliders import Collider
from relight.figures.draw.person import sample_person
from relight.figures.draw.poses import poses
from relight.figures.draw.shoes import shoes
from relight.meshes.geometry import edges


def motion_in(shoe, body, pose="relaxed"):
    return build_motion(body, replace(poses()[pose], heels=footwear.heel_pitch(body, shoe)), 1)


@pytest.mark.parametrize("shoe", shoes(), ids=lambda shoe: shoe.name)
def test_build_shoes_has_its_pieces_around_the_foot(body, shoe):
    motion = motion_in(shoe, body)
    skin, parts = motion.posed_skin, footwear.build_shoes(motion, shoe)
    pieces = {"upper": True, "sole": True, "cap": shoe.cap, "lace": shoe.laces}
    assert {name for name, _ in parts} == {name for name, there in pieces.items() if there}
    foot = motion.skin(np.eye(len(motion.bones))[[motion.bones["foot.L"]]], body.joints["foot.L"][None])[0, 1]
    for name, (vertices, faces) in parts:
        assert len(faces) and np.isfinite(vertices).all() and faces.max() < len(vertices)
        assert name != "lace" or (edges(faces)[2] == 2).all(), "closed"
        used = vertices[np.unique(faces)]
        assert np.abs(used[:, 0]).max() < np.abs(skin[skin[:, 1] < 0.1, 0]).max() + 0.03
        assert used[:, 1].max() - foot < max(shoe.top, 0) + 0.06
    soles = np.concatenate([vertices for name, (vertices, _) in parts if name == "sole"])
    assert soles[:, 1].min() == pytest.approx(skin[:, 1].min() - shoe.sole, abs=0.006)  # the ball is the lowest
    ankle = body.joints["foot.L"]
    heel = skin[(body.skin[:, 1] < ankle[1]) & (body.skin[:, 2] < ankle[2]), 1].min()
    assert soles[:, 1].min() == pytest.approx(heel - shoe.heel, abs=0.006)
    if shoe.cap:
        caps, uppers = ([x[np.unique(f)] for name, (x, f) in parts if name == kind] for kind in ("cap", "upper"))
        for cap, upper in zip(caps, uppers, strict=True):
            assert cap[:, 2].mean() > upper[:, 2].mean() + 0.05  # at the toes


@pytest.mark.parametrize("person", [3, 69])  # the bare heels of the second are 3 mm higher than their balls
@pytest.mark.parametrize("shoe", shoes(), ids=lambda shoe: shoe.name)
def test_build_shoes_stand_on_heel_and_ball_as_the_feet_do_in_them(person, shoe):
    body = build_body(sample_person(np.random.default_rng(person)))
    motion = motion_in(shoe, body, "straight")
    soles = [surface for name, surface in footwear.build_shoes(motion, shoe) if name == "sole"]
    ground = min(vertices[:, 1].min() for vertices, _ in soles)
    for side, (vertices, faces) in zip("LR", soles, strict=True):
        ankle, toe = body.joints[f"foot.{side}"], body.joints[f"toe3-1.{side}"]
        is_foot = ((body.skin[:, 0] > 0) == (side == "L")) & (body.skin[:, 1] < ankle[1])
        behind = body.skin[:, 2] - body.skin[is_foot, 2].min()  # metres from the heel's end
        for near in (behind < 0.05, np.abs(body.skin[:, 2] - toe[2]) < 0.025, body.skin[:, 2] > toe[2] + 0.025):
            skin, below = motion.posed_skin[is_foot & near], Collider.at_rest(vertices, faces)
            face, depth = below.raycast(skin + [0, 0.1, 0], np.array([0.0, -1.0, 0.0]))
            above = depth[face >= 0] - 0.1  # metres of the skin over the sole
            assert -0.002 < above.min() < 0.002
            ahead = vertices[:, 2]
            under = vertices[(ahead > skin[:, 2].min()) & (ahead < skin[:, 2].max())]
            assert under[:, 1].min() == pytest.approx(ground, abs=0.001)
