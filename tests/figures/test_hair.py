"""Faces and hair: expressions with the mouth closed, strands that cover the scalp, off the face and out of the head."""

from dataclasses import replace

import numpy as np
import pytest

from relight.figures.assemble.assembly import Assembly
from relight.figures.assemble.builder import Builder
from relight.figures.assemble.hair import facial, strands
from relight.figures.assemble.hair.combing import Head
from relight.figures.assemble.hair.heads import HairPart, build_hair
from relight.figures.body import makehuman
from relight.figures.body.motion import build_motion
from relight.figures.body.shape import build_body
from relight.figures.drape import colliders
from relight.figures.drape.dress import details
from relight.figures.draw import hairstyles
from relight.figures.draw.outfits import in_other_fabrics, sample_outfit
from relight.figures.draw.person import Expression, expressions, units
from relight.figures.draw.poses import poses
from relight.figures.dye import skin
from relight.figures.surfaces import normals, stacked

STYLES = hairstyles.styles()


@pytest.fixture(scope="module")
def head(body):
    """A body, its pose, and its posed skin: all that hair needs."""
    motion = build_motion(body, poses()["relaxed"], 1)
    return body, motion, (motion.posed_skin, makehuman.base().faces["body"])


def grown(head, name: str, fine: bool = False) -> list[HairPart]:
    return build_hair(Head(head[1], colliders.Collider.at_rest(*head[2]), 5, fine), STYLES[name], 0.8)


def strips(parts: list[HairPart], *kinds: str) -> list[strands.Strip]:
    return [strip for kind, strip in parts if kind in kinds]


@pytest.fixture(scope="module")
def heads(head):
    return {name: grown(head, name) for name in STYLES}


@pytest.mark.parametrize("name", expressions())
def test_build_body_expression_moves_the_face_and_keeps_the_mouth_closed(body, name):
    calm = build_body(body.person).vertices
    face = build_body(body.person, Expression(name, units(name))).vertices
    gap = face[skin.UPPER_LIP, 1] - face[skin.LOWER_LIP, 1]
    assert gap < calm[skin.UPPER_LIP, 1] - calm[skin.LOWER_LIP, 1] + 0.001
    moved = np.linalg.norm(face - calm, axis=1)
    assert moved[makehuman.base().vertices[:, 1] < 0.5].max() == 0
    assert moved.max() == 0 if name == "calm" else 0.002 < moved.max() < 0.03


@pytest.mark.parametrize("style", [name for name, style in STYLES.items() if style.comb])
@pytest.mark.slow
def test_build_hair_is_finite_and_outside_of_the_head(head, heads, style):
    surface = colliders.Collider(head[2][0], *head[2])
    for kind, (vertices, faces, uv) in heads[style]:
        assert np.isfinite(vertices).all() and uv.min() >= 0 and uv.max() <= 1
        assert faces.max() < len(vertices) == len(uv)
        _, distance, _ = colliders.signed_distance(vertices, surface, 0.05)
        assert np.mean(distance < -0.008) < 0.01, kind


@pytest.mark.parametrize("style", ["chin length", "long", "wavy long", "ponytail", "beanie", "cap"])
def test_build_hair_leaves_the_face_free(head, heads, style):
    built, motion, _ = head
    turn, eye = motion.bone("head"), built.vertices[makehuman.EYES["L"]].mean(0)
    for vertices, _, _ in strips(heads[style], "hair", "hat"):
        rest = (vertices - turn[:, 3]) @ turn[:, :3] - eye
        before = (rest[:, 2] > -0.01) & (np.abs(rest[:, 0] + eye[0]) < 1.6 * eye[0]) & (np.abs(rest[:, 1]) < 0.02)
        assert before.mean() < 0.002


def test_grow_locks_fall_and_lie_on_the_shoulders(head, heads):
    _, _, (posed, faces) = head
    ((vertices, _, _),) = strips(heads["long"], "hair")
    neck = np.ptp(posed[:, 1]) * 0.8
    assert vertices[:, 1].min() < neck  # it reaches below the shoulders
    _, distance, _ = colliders.signed_distance(vertices, colliders.Collider(posed, posed, faces), 0.1)
    assert np.median(distance[(vertices[:, 1] < neck + 0.02) & np.isfinite(distance)]) < 0.04


@pytest.mark.parametrize("name", [name for name, style in STYLES.items() if style.comb and style.hat == "none"])
def test_build_hair_shows_little_scalp_from_any_side(head, name):
    _, _, (posed, faces) = head
    hair = stacked([(vertices, faces) for vertices, faces, _ in strips(grown(head, name, fine=True), "hair")])
    inside = skin.above_hairline(makehuman.base().vertices[makehuman.BODY]) > 0.12
    out, cover = normals(posed, faces), colliders.Collider.at_rest(*hair)
    seen = total = 0
    for direction in np.random.default_rng(2).normal(size=(24, 3)):
        direction /= np.linalg.norm(direction)
        facing = np.flatnonzero(inside & (out @ direction > 0.3))
        start = posed[facing] + 0.4 * direction
        _, depth = cover.raycast(start, np.broadcast_to(-direction, start.shape))
        seen, total = seen + int((depth > 0.4).sum()), total + len(facing)
    assert seen / total < 0.15


def test_beard_grows_on_jaw_and_lip_only(head, heads):
    _, motion, below = head
    base = makehuman.base().vertices[makehuman.BODY]
    share, eye = skin.beard_share(base), makehuman.base().vertices[makehuman.EYES["L"]].mean(0)
    assert share.max() > 0.9 and not share[base[:, 1] > eye[1] - 0.02].any()
    assert not share[base[:, 2] < eye[2] - 0.1].any()  # not on the nape
    assert (skin.beard_share(base[[skin.UPPER_LIP, skin.LOWER_LIP]]) == 0).all()
    assert facial.beard(Head(motion, None, 5, False), facial.STUBBLE) is None
    surface = colliders.Collider(below[0], *below)
    _, distance, _ = colliders.signed_distance(strips(heads["bald"], "beard")[0][0], surface, 0.1)
    assert np.mean(distance < -0.004) < 0.02 and distance.max() < 0.05


def test_add_hair_hats_change_with_the_outfit_and_hair_does_not(head):
    outfit = sample_outfit(np.random.default_rng(3), head[0].person)
    outfit = replace(outfit, hair=STYLES["cap"], beard=0.8)
    outfit = replace(outfit, hat=outfit.garments[0].fabric)
    looks = [outfit, in_other_fabrics(outfit, np.random.default_rng(4))]
    builder = Builder()
    Assembly(builder, head[1], outfit, [], replace(details()["draft"], texture=64), 5).add_hair(head[2])
    mesh = builder.mesh({}, looks)
    assert len(builder.vertices) == len(mesh.materials) + 1, "a part for each material, but two of the hat"
    assert sorted(material.name for material in mesh.materials) == ["beard", "brows", "hair", "hat", "lashes"]
    hats = [number for number, material in enumerate(mesh.materials) if material.name == "hat"]
    assert sorted(mesh.outfits[0]) == hats
    assert all((mesh.outfits[0][hat].texture != mesh.materials[hat].texture).any() for hat in hats)
