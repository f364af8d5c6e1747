"""People one by one, by networks that know the truth; and by MediaPipe's, where they are set up, against its Python."""

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

import relight
from relight.photos.mask import networks, pose, selfie
from relight.photos.mask.people import mask_doubts, split_people

HAS_NETWORKS = networks.is_set_up()  # of the user, before a fixture hides them
DATA = os.environ.get("RELIGHT_DATA")
RED, GREEN, BLUE, YELLOW = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)
CELLS = [  # (x, y) of the middle of each of the first network's boxes, as MediaPipe's options for anchors say
    ((x + 0.5) * stride, (y + 0.5) * stride)
    for stride, boxes in ((8, 2), (16, 2), (32, 6))
    for y in range(224 // stride)
    for x in range(224 // stride)
    for _ in range(boxes)
]


def middle(image, color):
    """(x, y) of what has a color in an image (3,H,W) of 0 to 255; None if too little of it is there."""
    near = np.abs(image - np.array(color)[:, None, None]).max(0) < 100
    return np.argwhere(near).mean(0)[::-1] + 0.5 if near.sum() >= 4 else None


class Detector:
    """Takes red for the middle of the hips and green for the point of the circle, in three overlapping boxes."""

    def run(self, _, inputs):
        image = (inputs["image"][0] + 1) * 127.5
        hips, top = middle(image, RED), middle(image, GREEN)
        boxes, scores = np.zeros((1, 2254, 12), np.float32), np.full((1, 2254, 1), -9.0, np.float32)
        if hips is not None and top is not None:
            for cell, score in ((2000, 2.0), (900, 1.0), (40, 0.5)):
                points = np.array([hips, hips + CELLS[cell], hips, top, hips, top]) - CELLS[cell]
                points[1] = 60
                boxes[0, cell], scores[0, cell] = points.ravel(), score
        return [boxes, scores]


class Landmarks:
    """Takes blue for the left wrist, yellow for the person, and red and green as the first network does."""

    def run(self, _, inputs):
        image = inputs["image"][0] * 255
        points = np.zeros((1, 39, 5), np.float32)
        points[0, 15, :2], points[0, 15, 3] = middle(image, BLUE), 9
        points[0, 33:35, :2] = middle(image, RED), middle(image, GREEN)
        person = np.abs(image - np.array(YELLOW)[:, None, None]).max(0) < 128
        return [points.reshape(1, 195), np.float32([[1]]), np.where(person, 20, -20)[None, None].astype(np.float32)]


@pytest.mark.parametrize(("size", "angle"), [((300, 400), 0), ((900, 400), 70), ((640, 480), 180), ((200, 900), -120)])
def test_a_body_is_where_it_is_in_the_photo(monkeypatch, size, angle):
    """Upright, lying, upside down; it is one, however many windows show it."""
    monkeypatch.setattr(pose, "load_network", {networks.DETECTOR: Detector(), networks.LANDMARKS: Landmarks()}.get)
    up = np.array([np.sin(np.radians(angle)), -np.cos(np.radians(angle))])
    across, hips = np.array([-up[1], up[0]]), np.array(size) * [0.4, 0.5]
    places = {RED: hips, GREEN: hips + 80 * up, BLUE: hips + 50 * across + 20 * up}
    image = Image.new("RGB", size, (128, 128, 128))
    draw, drawn = ImageDraw.Draw(image), Image.new("L", size)
    corners = [tuple(hips + a * across + b * up) for a, b in ((-25, -45), (-25, 45), (25, 45), (25, -45))]
    draw.polygon(corners, fill=YELLOW)
    ImageDraw.Draw(drawn).polygon(corners, fill=255)
    for color, (x, y) in places.items():
        draw.ellipse([x - 9, y - 9, x + 9, y + 9], fill=color)
    (body,) = pose.find_bodies(np.asarray(image), np.asarray(drawn) / np.float32(255))
    assert abs(body.score - 1 / (1 + np.exp(-2))) < 1e-6
    assert np.abs(body.place * size - [hips, hips + 80 * up]).max() < 1.5
    x, y, seen = body.joints[15]
    assert np.abs(np.array([x, y]) * size - places[BLUE]).max() < 1.5 and seen > 0.99
    solid = np.asarray(drawn) > 127
    for color in places:
        solid &= np.abs(np.asarray(image).astype(int) - color).max(-1) > 128
    found = body.mask(size) > 0.5
    assert (found & solid).sum() / (found | solid).sum() > 0.9
    assert np.abs(body.mask((100, 50), (0.25, 0.5, 0.75, 1)) - body.mask((200, 100))[50:, 50:150]).max() < 1e-3


def test_people_in_a_crowd_larger_than_the_photo_are_nobody(monkeypatch):
    monkeypatch.setattr(pose, "load_network", {networks.DETECTOR: Detector()}.get)
    monkeypatch.setattr(pose, "LARGEST", 0.1)
    image = Image.new("RGB", (300, 300))
    for color, y in ((RED, 200), (GREEN, 100)):
        ImageDraw.Draw(image).ellipse([140, y, 160, y + 20], fill=color)
    assert pose.find_bodies(np.asarray(image), np.zeros((300, 300), np.float32)) == []


def body_of(mask, hips=0):
    """A body with this mask (256,256) bool over the whole photo, upright above its hips (a column), without joints."""
    place = np.array([[hips, 112], [hips, 20]]) / 224
    return pose.Body(np.zeros((33, 3), np.float32), mask.astype(np.float32), np.eye(2, 3) / 256, place)


def test_thick_pieces_are_added_and_gaps_dropped(monkeypatch):
    """The first network misses an arm, and has a gap too much, which a bag beside it has a color of its own from."""
    y, x = np.mgrid[:256, :256]
    trunk, arm = (abs(x - 128) < 30) & (y > 40) & (y < 230), (abs(y - 100) < 9) & (x >= 158) & (x < 220)
    held, rim = (np.hypot(x - 85, y - 150) < 16) & (x <= 98), (abs(x - 128) < 31) & (y > 40) & (y < 230) & ~trunk
    gap, bag = ((abs(y - row) < 12) & (x >= 158) & (x < 176) for row in (140, 180))
    true = trunk | arm | held | bag
    pixels = np.where(true[..., None], (220, 190, 170), (40, 60, 50)).astype(np.uint8)
    pixels[bag] = 40, 30, 160
    monkeypatch.setattr(selfie, "segment_coarsely", lambda _: (trunk | held | gap | bag).astype(np.float32))
    monkeypatch.setattr(selfie, "find_bodies", lambda *_: [body_of(trunk | arm | rim)])
    found, bodies = selfie.segment(pixels)
    assert len(bodies) == 1 and ((found > 127) & true).sum() / ((found > 127) | true).sum() > 0.98
    joined = partial(selfie.joined, limbs=[tuple(np.empty((2, 0), int))], picture=pixels)
    trunk_alone, people = (mask.astype(np.float32) for mask in (trunk, trunk & (y > 190)))
    added = joined(trunk_alone, [(trunk | arm | rim | gap).astype(np.float32)]) > 0.5
    assert added[arm].all() and not added[rim & (y > 120) & (y < 190)].any() and not added[gap].any()
    limb = np.array([140]), np.array([166])  # in the gap, as of an arm in the background's color
    assert (joined(trunk_alone, [trunk_alone + gap], limbs=[limb])[gap] > 0.5).all()
    assert (joined(trunk_alone + gap, [people])[gap] > 0.5).all()  # what is large may be a person
    for value, is_kept in ((0.7, False), (0.9, True)):  # a bag that the first network is unsure or fairly sure of
        first = np.where(bag, value, trunk).astype(np.float32)
        assert ((joined(first, [trunk_alone])[bag] > 0.5) == is_kept).all()
    faint = np.where(held & trunk, 0.4, trunk).astype(np.float32)  # what it hardly sees, and the second clearly
    assert (joined(faint, [trunk_alone])[held & trunk] > 0.5).all()


def test_those_whom_others_hide_are_found_without_them(monkeypatch):
    """Behind one person, found twice, another stands at the same place, and a crowd that hardly looks like people.

    A third, at the right, is a part of the mask of another network alone. At last each of the three is looked at alone,
    and keeps the pixels at which no other one is surer.
    """
    x = np.indices((224, 224))[1]
    wide = {80: 30, 81: 31, 82: 75, 200: 20, 211: 10}  # half the width of each, by the middle of the hips
    people = {hips: body_of(np.pad(abs(x - hips) < half, 16), hips) for hips, half in wide.items()}

    def search(photo):
        is_hidden = photo[112, 80, 0] > 0
        for score, hips in [(0.8, 82.0), (0.7, 200.0)] if is_hidden else [(0.6, 80.0), (0.55, 81.0)]:
            yield score, np.array([[hips, 112], [hips, 20]])

    def look_at(photo, place):
        looks.append((place[0, 0], photo[112, 80, 0], photo[112, 130, 0]))
        return people[int(place[0, 0])]

    looks, photo = [], np.repeat(np.uint8(40 * (abs(x - 82) >= 75))[..., None], 3, 2)
    monkeypatch.setattr(pose, "_search", search)
    monkeypatch.setattr(pose, "_look_at", look_at)
    found = np.where((abs(x - 211) < 8) | (x < 100), np.float32(0.9), np.float32(0))
    assert [body.score for body in pose.find_bodies(photo, found)] == [0.6, 0.8, 1]
    assert [(hips, left > 0, right > 0) for hips, left, right in [*looks[:3], *looks[-4:]]] == [
        (80, False, False), (81, False, False), (82, True, False), (211.5, False, False),
        (80, False, True), (82, False, False), (211, True, True),
    ]  # fmt: skip


def test_people_who_touch_are_two_and_a_ball_is_none():
    y, x = np.mgrid[:256, :256]
    left, right = np.hypot(x - 80, (y - 128) / 2) < 40, np.hypot(x - 158, (y - 128) / 2) < 40
    stranger, ball = np.hypot(x - 230, y - 60) < 20, np.hypot(x - 20, y - 230) < 6
    coverage = np.where(left | right | stranger | ball, np.uint8(255), np.uint8(0))
    bodies = [body_of(right & (x > 122)), body_of(left | (right & (x < 126)))]
    parts = split_people(coverage, bodies)
    assert [body for _, body in parts] == [bodies[1], bodies[0], None]
    assert (sum(part.astype(int) for part, _ in parts) == coverage).all()
    first, second, third = (part > 0 for part, _ in parts)
    assert first[128, 121] and second[128, 130] and (third == stranger).all() and first[230, 20]
    seam = parts[1][0][128, 100:150].astype(int)
    assert (np.diff(seam) >= 0).all() and ((seam > 0) & (seam < 255)).sum() in range(4, 9)  # 3 % of 256
    assert len(split_people(coverage)) == 2


def test_doubts_name_limbs_and_places():
    """A mask that lacks a leg and holds a pillar; joints that are out of the photo, or not seen, raise no doubt."""
    y, x = np.mgrid[:256, :256]
    trunk, legs = (abs(x - 128) < 30) & (y > 40) & (y < 150), (abs(abs(x - 128) - 18) < 10) & (y >= 150) & (y < 250)
    pillar = (x > 170) & (x < 200) & (y > 40) & (y < 120)
    joints = np.zeros((33, 3), np.float32)
    joints[:, :2], joints[:, 2] = (128, 90), 0.9
    joints[27, :2], joints[28, :2], joints[15, :2], joints[16] = (146, 240), (110, 240), (128, 300), (10, 10, 0.3)
    joints[:, :2] /= 256
    body = replace(body_of(trunk | legs), joints=joints)

    def said(mask, scale=1):
        return mask_doubts(np.where(mask.repeat(scale, 0).repeat(scale, 1), np.uint8(255), np.uint8(0)), [body])

    assert said(trunk | legs) == said(trunk | legs, 4) == []
    *limbs, whole = said(trunk | legs & (x > 128))
    assert limbs == ["the right shin is not in the mask", "the right foot is not in the mask"]
    assert whole == "the networks disagree about the mask, mostly at the lower left"
    joints[26, :2] = np.array((110, 170)) / 256
    assert said((trunk | legs) & ((x > 128) | (abs(y - 205) > 7)))[0] == "the right shin is not in the mask"
    (one,) = said(trunk | legs | pillar | (abs(y - 80) < 3) & (x > 128) & (x < 180))
    assert "mostly at the upper right" in one
    for thread in (0, 2):
        (one,) = said(trunk | legs | (np.hypot(x - 60, y - 60) < 5) | (abs(y - 60) < thread) & (x > 60) & (x < 128))
        assert one == "a part apart from the body, at the upper left, may be a thing, or background"
    solid = np.where(trunk | legs, np.uint8(255), np.uint8(0))
    faint = body.seen * np.where(y < 160, 0.7, 1).astype(np.float32)
    unclear = mask_doubts(solid, [replace(body, score=0.65)]) + mask_doubts(solid, [replace(body, seen=faint)])
    assert unclear == ["hardly recognized as a person: the mask may be wrong",
                       "the outline is unclear: background may be in the mask"]  # fmt: skip
    held = ["what is not in the mask at the upper left may belong to them, as what they hold does"]
    for radius, told in ((14, held), (3, [])):
        ball = 0.4 * (np.hypot(x - 70, y - 70) < radius)
        assert mask_doubts(solid, [replace(body_of((trunk | legs) + ball), joints=joints)]) == told
    neighbour = np.roll(trunk | legs, 70, 1)
    other = replace(body_of(neighbour), joints=(joints + [70 / 256, 0, 0]).astype(np.float32))
    seen = replace(body_of((trunk | legs) + 0.6 * (neighbour & (x < 190))), joints=joints)
    assert mask_doubts(np.where(trunk | legs | neighbour, np.uint8(255), np.uint8(0)), [seen, other]) == []
    strangers = said(trunk | legs | (x > 220) & (y > 60) & (y < 200))
    assert strangers == ["person 2: no joints were found in this part of the mask: it may be a thing, or background"]


@pytest.mark.skipif(not HAS_NETWORKS, reason="relight mask setup")
def test_networks_say_what_mediapipe_says(monkeypatch):
    """Numbers of MediaPipe 0.10.21 for the portrait of the pages. It moves joints a little by heat maps, too."""
    monkeypatch.setenv("RELIGHT_DATA", DATA) if DATA else monkeypatch.delenv("RELIGHT_DATA")
    pixels = np.asarray(Image.open(Path(relight.__file__).parent / "viewer" / "web" / "astronaut.jpg").convert("RGB"))
    hips, top = np.array([0.3123, 1.0304]) * 512, np.array([0.4639, 0.0547]) * 512
    side = pose.ROOM * 2 * np.hypot(*(top - hips))
    score, place = max(pose._detect(pixels), key=lambda each: each[0])
    assert abs(score - 0.807) < 0.03 and np.abs(np.array(place) - [hips, top]).max() < 0.04 * 512
    body = pose._look_at(pixels, np.stack([hips, top]))
    joints = {0: (221, 129), 2: (248, 113), 5: (204, 104), 9: (232, 154)}
    joints |= {10: (203, 147), 11: (306, 262), 12: (111, 240)}
    for joint, expected in joints.items():
        assert np.hypot(*(body.joints[joint, :2] * 512 - expected)) < 0.025 * side and body.joints[joint, 2] > 0.98
    rows = body.mask((512, 512)).reshape(8, 64, 8, 64).mean((1, 3))[:5, 2:]  # without the flag and the helmet
    expected = [
        [0.18, 0.70, 0.31, 0, 0, 0], [0.51, 1, 0.64, 0, 0, 0], [0.62, 1, 0.16, 0, 0, 0], [1, 1, 0.71, 0.03, 0, 0],
        [1, 1, 1, 0.52, 0, 0],
    ]  # fmt: skip
    assert np.abs(rows - expected).max() < 0.1
