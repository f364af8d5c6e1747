"""Scarves, tucked tops, and hands that stay out of the clothes."""

from dataclasses import replace

import numpy as np
import pytest

from relight.figures.assemble import layers
from relight.figures.body import makehuman
from relight.figures.body.motion import build_motion
from relight.figures.body.shape import build_body
from relight.figures.cut import patterns
from relight.figures.cut.footwear import upper
from relight.figures.cut.level import Level
from relight.figures.drape import collars
from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.drape.dress import DrapedGarment, details, drape_outfit, drape_scarf
from relight.figures.drape.simulate import DrapeResult
from relight.figures.draw import fitting, outfits
from relight.figures.draw.fabrics import Fabric
from relight.figures.draw.garments import Worn, group, wardrobe
from relight.figures.draw.person import sample_person
from relight.figures.draw.poses import poses
from relight.figures.draw.shoes import shoes
from relight.figures.dye import panels
from relight.figures.gates import checks
from relight.figures.surfaces import border_loops, grid_faces

CLOTH = Fabric("plain", (0.3, 0.1, 0.05), (0.1, 0.4, 0.7), 1.0, 5)


@pytest.fixture(scope="module")
def standing(body):
    motion = build_motion(body, poses()["straight"], 1)
    return motion, motion.posed_skin


@pytest.mark.parametrize("garment", group("scarves").values(), ids=lambda garment: garment.name)
def test_drape_scarf_lies_around_the_neck_and_hangs_in_front(body, standing, garment):
    motion, skin = standing
    faces = makehuman.base().faces["body"]
    worn = drape_scarf(motion, Worn(garment, CLOTH), (skin, faces), [], details()["draft"])
    x, neck = worn.draped.positions, collars.neck_of(motion)
    near = (x - neck.base)[np.linalg.norm(x - neck.base, axis=1) < 0.17]
    around = np.unique(np.round(np.degrees(np.arctan2(near @ neck.left, near @ neck.forward)) / 20))
    assert len(around) >= 15  # of 19: all sides but perhaps the front
    low = x[x[:, 1] < neck.base[1] - 0.15]
    assert (low[:, 2] > neck.base[2]).all() and low[:, 0].min() < -0.03 and low[:, 0].max() > 0.03
    assert checks.check_garment(worn.pattern, worn.draped, motion) is None
    _, distance, _ = signed_distance(x, Collider(skin, skin, faces), 0.1)
    assert np.percentile(distance, 1) > -0.002


@pytest.mark.parametrize("name", ["shirt", "jacket", "blazer", "coat"])
def test_a_collar_has_no_smeared_texture(body, standing, name):
    """By the area of each face in the texture, in square metres, against that in space."""
    pattern = patterns.build_pattern(body, wardrobe()[name], 1)
    level, atlas = pattern.levels[-1], panels.lay_out(*panels.cloth_coordinates(pattern), 1024)
    uv, per_metre = np.zeros((len(level.fitted), 2)), atlas.scale / atlas.side
    uv[level.faces] = atlas.uv
    cloth, neck = standing[0].skin(level.weights, level.fitted), collars.neck_of(standing[0])
    vertices, faces, corners = collars.collar(cloth, level.faces, uv, wardrobe()[name].collar, neck, per_metre)
    flat = np.pad(corners / per_metre, [(0, 0), (0, 0), (0, 1)])
    sides = (np.diff(part, axis=1) for part in (vertices[faces], flat))
    true, drawn = (np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1) for side in sides)
    assert true[drawn < 0.3 * true].sum() < 0.2 * true.sum()


def test_tucked_top_is_pinned_below_the_waistband_only(body):
    top, bottom = fitting.tucked(wardrobe()["t-shirt"], wardrobe()["jeans"])
    pattern, edge = patterns.build_pattern(body, top, 0), body.heights["waist"] + bottom.waist
    y, pinned = pattern.fields["y"], pattern.levels[0].pin_weight
    assert (pinned[y < edge - 0.01] > 0.89).all()
    assert (pinned[(y > edge + 0.035) & (pattern.fields["arm_shareL"] + pattern.fields["arm_shareR"] < 0.1)] == 0).all()


def test_hidden_under_a_lifted_garment_is_no_skin_that_is_seen(body):
    """A sheet of cloth on skin: what it lies on is left out; lifted on one side, only what is still dark."""
    x, y = np.meshgrid(a := np.linspace(-0.5, 0.5, 41), a)
    faces, skin = grid_faces(41, 41)[:, ::-1], np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    snug = skin + [0, 0, 0.004]
    lifted = snug + [0, 0, 0.04] * (skin[:, :1] > 0)
    normal, no_drop = np.tile([0.0, 0, 1], (len(skin), 1)), {"drop": np.zeros(len(skin))}
    level = Level(skin, skin, snug, np.zeros(len(skin)), np.zeros((len(skin), 1)), faces)
    pattern = patterns.Pattern(body, wardrobe()["t-shirt"], [level], [], no_drop, np.zeros(len(faces), bool))

    def left_out(draped: np.ndarray) -> np.ndarray:
        around = Collider(*[np.concatenate([skin, draped])] * 2, np.concatenate([faces, faces + len(skin)]))
        worn = DrapedGarment(pattern, CLOTH, DrapeResult(draped, [], np.ones(1)))
        return layers.hidden_under(worn, skin, skin, normal, 2, around)

    inner = np.abs(skin[:, :2]).max(1) < 0.42
    assert left_out(snug)[inner].all() and not left_out(snug)[~inner & (np.abs(skin[:, :2]).max(1) > 0.46)].any()
    half = left_out(lifted)
    assert half[inner & (skin[:, 0] < -0.05)].all()
    assert not half[inner & (skin[:, 0] > 0.38)].any()  # a look of 4 cm under the hem


@pytest.mark.parametrize("name", ["tank top", "dress"])
def test_cut_from_suit_short_sleeves_leave_the_trunk_whole(name):
    """Hem, neck and two armholes that end under the arm, not a hand's breadth down the side."""
    body, garment = build_body(sample_person(np.random.default_rng(5))), wardrobe()[name]
    level = patterns.build_pattern(body, garment, 0).levels[0]
    loops = sorted(border_loops(level.faces), key=lambda ring: level.fitted[ring, 1].mean())
    assert len(loops) == 4
    for armhole in loops[1:3]:
        assert body.joints["upperarm01.L"][1] - level.fitted[armhole, 1].min() < (0.10 if garment.armhole else 0.09)


@pytest.mark.slow
def test_drape_outfit_hangs_trousers_over_the_shoes(body):
    shoe = next(s for s in shoes() if s.name == "boots")
    outfit = outfits.sample_outfit(np.random.default_rng(0), body.person)
    outfit = replace(outfit, garments=[Worn(wardrobe()["jeans"], CLOTH)], shoe=shoe)
    motion = build_motion(body, poses()["straight"], details()["draft"].frames)
    x = drape_outfit(motion, outfit, details()["draft"])[0].draped.positions
    for side in "LR":
        leather = upper(body, shoe, side)
        posed = motion.skin(leather.weights, leather.shape)
        _, distance, _ = signed_distance(x, Collider(posed, posed, leather.faces), 0.03)
        near = np.isfinite(distance) & (x[:, 1] < posed[:, 1].max() - 0.005)
        assert near.sum() > 20 and (distance[near] < -0.002).mean() < 0.02


@pytest.mark.parametrize(("gap", "share", "turned"), [(0.02, 1.0, False), (0.2, 0.0, False), (0.02, 0.0, True)])
def test_covered_hands_measures_a_hand_behind_cloth(body, standing, gap, share, turned):
    motion, skin = standing
    left = skin[(makehuman.bone_weights("finger", "metacarpal") > 0.7) & (body.skin[:, 0] > 0)]
    (x0, y0, _), (x1, y1, front) = left.min(0) - 0.05, left.max(0) + 0.05
    front += gap - 0.05
    sheet = np.array([[x0, y0, front], [x1, y0, front], [x1, y1, front], [x0, y1, front]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])[:, :: -1 if turned else 1]  # the back of a shirt, a hand behind it
    level = Level(sheet, sheet, sheet, np.zeros(4), np.zeros((4, 1)), faces)
    pattern = patterns.Pattern(body, wardrobe()["t-shirt"], [level], [], {}, np.zeros(2, bool))
    covered = checks.covered_hands([DrapedGarment(pattern, CLOTH, DrapeResult(sheet, [], np.ones(1)))], motion)
    assert covered == (share, 0.0) if share == 0 else covered[0] > 0.5 and covered[1] == 0.0


def test_fitted_to_pose_takes_off_coats_to_sit_and_scarves_to_cross_arms(body):
    outfit = outfits.sample_outfit(np.random.default_rng(0), body.person)
    clothes, library = (wardrobe()["jeans"], wardrobe()["coat"], group("scarves")["scarf"]), poses()
    outfit = replace(outfit, garments=[Worn(garment, CLOTH) for garment in clothes])

    def left(name):
        return [worn.garment.name for worn in outfits.fitted_to_pose(outfit, library[name]).garments]

    shirt = replace(outfit, garments=[Worn(wardrobe()["t-shirt"], CLOTH)])
    seated = outfits.fitted_to_pose(shirt, library["sitting"]).garments[0].garment
    assert seated.slack == seated.drop == 0
    assert seated.hem > wardrobe()["t-shirt"].hem, "shorter: the lap pushes tops up"
    assert left("relaxed") == left("hands behind") == ["jeans", "coat", "scarf"]
    assert left("sitting") == ["jeans", "scarf"] and left("arms crossed") == ["jeans", "coat"]
