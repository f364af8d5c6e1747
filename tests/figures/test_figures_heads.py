"""Faces and hair: expressions with the mouth closed, locks that stay off the face and outside of the head."""

import numpy as np
import pytest

from relight.figures import body, colliders, combing, hair, layers, locks, makehuman, poses
from relight.figures.stances import STANDING

UPPER_LIP, LOWER_LIP = 474, 494  # vertices of the base mesh where the lips meet, in the middle


@pytest.fixture(scope="module")
def person():
    return body.sample_person(np.random.default_rng(1))


@pytest.fixture(scope="module")
def head(person):
    """A body, its pose, and its posed skin: all that hair needs."""
    colliders.prepare()
    built = body.build_body(person)
    way = poses.motion(built, STANDING[0], 1)
    skin = way.skin(makehuman.rig().weights[makehuman.BODY], built.skin)
    return built, way, (skin, makehuman.base().faces["body"])


def grown(head, name: str, fine: bool = False) -> list[hair.Shell]:
    style = next(style for style in hair.STYLES if style.name == name)
    return hair.build_hair(*head[:2], style, head[2], 5, fine)


@pytest.fixture(scope="module")
def heads(head):
    """Each style's parts, grown once."""
    return {style.name: grown(head, style.name) for style in hair.STYLES}


@pytest.mark.parametrize("name", body.EXPRESSIONS)
def test_an_expression_moves_the_face_and_keeps_the_mouth_closed(person, name):
    calm = body.build_body(person).vertices
    face = body.build_body(person, body.Expression(name, body.units(name))).vertices
    gap = face[UPPER_LIP, 1] - face[LOWER_LIP, 1]
    assert gap < calm[UPPER_LIP, 1] - calm[LOWER_LIP, 1] + 0.001
    moved = np.linalg.norm(face - calm, axis=1)
    neck = makehuman.base().vertices[:, 1] < 0.5
    assert moved[neck].max() == 0
    assert moved.max() == 0 if name == "calm" else 0.002 < moved.max() < 0.03


def test_expressions_vary_and_follow_their_seed():
    drawn = [body.sample_expression(np.random.default_rng([seed, 3])) for seed in range(60)]
    assert {one.name for one in drawn} == set(body.EXPRESSIONS)
    assert drawn[7] == body.sample_expression(np.random.default_rng([7, 3]))
    assert all(0 <= weight <= 1 for one in drawn for weight in one.units.values())
    for unit in {unit for one in drawn for unit in one.units}:
        assert len(makehuman.target(unit)[0])  # the package has it


def test_a_lopsided_expression_swaps_its_sides():
    one, other = body.units("smirk"), body.units("smirk", swap=True)
    assert one["faceunits/mouthSmileLeft"] == other["faceunits/mouthSmileRight"] > other["faceunits/mouthSmileLeft"]


@pytest.mark.parametrize("style", [style.name for style in hair.STYLES if style.comb])
def test_hair_is_finite_and_outside_of_the_head(head, heads, style):
    skin = colliders.Collider(head[2][0], head[2][0], head[2][1])
    for part in heads[style]:
        assert np.isfinite(part.vertices).all() and part.uv.min() >= 0 and part.uv.max() <= 1
        assert part.faces.max() < len(part.vertices) == len(part.uv)
        _, distance, _ = layers.sided(part.vertices, skin, 0.05)
        assert np.mean(distance < -0.008) < 0.01, part.name


@pytest.mark.parametrize("style", ["chin length", "long", "wavy long", "ponytail", "beanie", "cap"])
def test_hair_and_hats_leave_the_face_free(head, heads, style):
    built, way, _ = head
    turn = way.transforms[-1, way.bones["head"]]
    eye = built.vertices[makehuman.EYES["L"]].mean(0)
    for part in heads[style]:
        rest = (part.vertices - turn[:, 3]) @ turn[:, :3] - eye
        before = (rest[:, 2] > -0.01) & (np.abs(rest[:, 0] + eye[0]) < 1.6 * eye[0]) & (np.abs(rest[:, 1]) < 0.02)
        assert before.mean() < 0.002, part.name


def test_what_hangs_before_the_face_is_moved_aside_and_on_shoulders_it_does_not_spread(head):
    built, way, _ = head
    turn = way.transforms[-1, way.bones["head"]]
    shy = locks.off_the_face(built, way)

    def moved(last, now) -> float:
        """The sideways move of points given from the head's centre, in its rest frame."""
        at, ahead = ((combing.head_centre(built) + np.array([p])) @ turn[:, :3].T + turn[:, 3] for p in (last, now))
        return float((shy(at, ahead) - ahead)[0] @ turn[:, 0])

    before, behind, low = np.array([0.02, -0.05, 0.10]), np.array([0.02, -0.05, -0.02]), np.array([0.08, -0.2, 0.0])
    assert moved(before, before) > 0.01 and moved(before * [-1, 1, 1], before * [-1, 1, 1]) < -0.01
    assert moved(behind, behind) == pytest.approx(0, abs=1e-12) == moved(low, low)
    assert moved(low, low + [0.01, 0, 0]) == pytest.approx(-0.0075, abs=1e-6)
    assert moved(low, low - [0.01, 0, 0]) == pytest.approx(0, abs=1e-12)  # inward is free


def test_the_same_seed_is_the_same_hair(head, heads):
    for part, twin in zip(heads["ponytail"], grown(head, "ponytail"), strict=True):
        assert np.array_equal(part.vertices, twin.vertices) and np.array_equal(part.uv, twin.uv)


def test_a_lock_keeps_its_length_and_a_draft_has_half_of_them(head, heads):
    built, _, below = head
    comb = combing.Comb(60, 0.2)
    roots = combing.plant(built, below[0], comb.count, 3)
    ahead, length = combing.combed(comb, roots)
    points, _ = locks.grown(comb, roots, ahead, length, colliders.Collider(below[0], below[0], below[1]), 10, 3)
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2)
    np.testing.assert_allclose(steps, np.repeat(length[:, None] / 10, 10, 1), rtol=1e-6)
    assert (roots.rim > 0).all()
    assert len(heads["long"][0].vertices) < 0.6 * len(grown(head, "long", fine=True)[0].vertices)


def test_hair_falls_with_gravity_and_lies_on_the_shoulders(head, heads):
    _, _, (skin, faces) = head
    part = heads["long"][0]
    neck = np.ptp(skin[:, 1]) * 0.8
    assert part.vertices[:, 1].min() < neck  # it reaches below the shoulders
    _, distance, _ = layers.sided(part.vertices, colliders.Collider(skin, skin, faces), 0.1)
    low = part.vertices[:, 1] < neck + 0.02
    assert np.median(distance[low & np.isfinite(distance)]) < 0.04
