"""Footwear: closed parts on the ground under the feet, caps, laces and straps where a shoe has them."""

import numpy as np
import pytest

from relight.figures.body import makehuman
from relight.figures.pose import stances
from relight.figures.pose.motion import build_motion
from relight.figures.tailor import footwear


@pytest.fixture(scope="module")
def feet(body):
    return body, build_motion(body, stances.poses()["relaxed"], 1)


@pytest.mark.parametrize("shoe", footwear.shoes(), ids=lambda shoe: shoe.name)
def test_build_shoes_has_its_pieces_around_the_foot(feet, shoe):
    built, motion = feet
    skin = motion.skin(makehuman.rig().weights[makehuman.BODY], built.skin)
    parts = footwear.build_shoes(motion, shoe)
    names = {part.name for part in parts}
    expected = {"upper", "sole"} | ({"cap"} if shoe.cap else set()) | ({"lace"} if shoe.laces else set())
    assert names == expected == names & set(footwear.palette(shoe, (0.5, 0.4, 0.3), (0.1, 0.1, 0.1)))
    for part in parts:
        assert len(part.faces) and np.isfinite(part.vertices).all() and part.faces.max() < len(part.vertices)
        used = part.vertices[np.unique(part.faces)]
        assert np.abs(used[:, 0]).max() < np.abs(skin[skin[:, 1] < 0.1, 0]).max() + 0.03
        top = (
            used[:, 1].max()
            - motion.skin(np.eye(len(motion.bones))[[motion.bones["foot.L"]]], built.joints["foot.L"][None])[0, 1]
        )
        assert top < max(shoe.top, 0) + 0.06
    soles = np.concatenate([part.vertices for part in parts if part.name == "sole"])
    lowest = skin[:, 1].min()
    assert soles[:, 1].min() == pytest.approx(lowest - shoe.heel, abs=0.006)
    if shoe.cap:
        caps = [part.vertices[np.unique(part.faces)] for part in parts if part.name == "cap"]
        uppers = [part.vertices[np.unique(part.faces)] for part in parts if part.name == "upper"]
        for cap, upper in zip(caps, uppers, strict=True):
            assert cap[:, 2].mean() > upper[:, 2].mean() + 0.05  # at the toes


def test_build_shoes_are_alike_on_both_feet(feet):
    parts = footwear.build_shoes(feet[1], footwear.shoes()[1])
    half = len(parts) // 2
    for left, right in zip(parts[:half], parts[half:], strict=True):
        assert left.name == right.name
        assert left.vertices[:, 0].mean() > 0.02 and right.vertices[:, 0].mean() < -0.02
        assert len(left.vertices) == pytest.approx(len(right.vertices), rel=0.05)
