"""Builds a garment's pattern for a body.

A garment is cut from a smooth suit around the body (MakeHuman's tights), moved outward by its ease, lengthened,
extended by a drop (skirts, coat tails), and refined by Loop subdivision.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse

from relight.figures.body import makehuman
from relight.figures.body.shape import Body
from relight.figures.cut.cuts import cut_from_suit, hem_height, neck_field
from relight.figures.cut.drops import add_drop, lowest_border, split_border
from relight.figures.cut.level import Level
from relight.figures.cut.suit import BLADES, Fields, arm_share, expand_evenly, suit_fields, trunk_hull
from relight.figures.draw.garments import ARM_AT, LEG_AT, TORSO_AT, Garment
from relight.figures.surfaces import loop, normals, smoothed, unit_rows

PIN_OFFSET = 0.004  # metres from the suit to pinned cuffs, waistbands and necklines
MAX_START_EASE = 0.006  # metres: the simulation begins with cloth closer to the body than it is cut
HEM = 0.06  # height above the crotch where the length of a drop with a seam at the waist begins, metres
LEG = 0.82  # metres from hip to ankle, for which the lengths of drops are given
FADE = 0.12  # metres below that over which this begins
STRAIGHT_EASE = (0.006, 0.024)  # ease at the waist at which a top begins to hang straight, and hangs straight, metres
BELT = 0.020  # half the height of the cloth that a belt pins, metres
BELT_FADE = 0.02  # metres beyond that over which the pins fade


@dataclass(frozen=True)
class Pattern:
    """A garment cut for one body.

    Attributes:
        body: in its rest pose.
        garment: its description.
        levels: from coarse to fine.
        refine: matrices from each level's vertices to those of the next.
        fields: of the finest vertices, see `suit_fields`; and `drop`, 0 above a drop to 1 at its end.
        sleeve: (F,) whether a finest face belongs to a sleeve.
    """

    body: Body
    garment: Garment
    levels: list[Level]
    refine: list[sparse.csr_matrix]
    fields: Fields
    sleeve: np.ndarray


def build_pattern(body: Body, garment: Garment, levels: int) -> Pattern:
    """Builds the pattern of a garment for a body.

    Args:
        body: in its rest pose.
        garment: to be cut.
        levels: number of subdivisions; edges of 25 mm become 13 and 6 mm long.
    """
    suit = suit_fields(body)
    # The length of a drop is proportional to the legs, and begins at the garment's seam, above the hips, if it has one.
    leg = body.joints["upperleg01.L"][1] - body.joints["foot.L"][1]
    above = 0.0 if garment.seam is None else hem_height(body, garment) - body.heights["crotch"] - HEM
    garment = replace(garment, drop=garment.drop * min(1.1, leg / LEG) + above)
    matrix, faces, sleeve = cut_from_suit(body, garment, suit)
    fields = {name: matrix @ values for name, values in suit.items()}
    weights = matrix @ makehuman.rig().weights[makehuman.TIGHTS]
    weights /= weights.sum(1, keepdims=True)
    points = matrix @ body.tights
    hull = trunk_hull(body.tights, suit, body.heights)
    hanging = points
    if garment.kind != "trousers":
        spanned = np.clip((body.heights["neck"] - BLADES - points[:, 1]) / FADE, 0, 1)
        spanned *= np.clip(1 - 5 * arm_share(fields), 0, 1)
        points = hanging = expand_evenly(hull, points, faces, spanned)
    if garment.kind == "top":
        low = hem_height(body, garment) if garment.tuck_height is None else body.heights["waist"] + garment.tuck_height
        straight = 0.0 if garment.front_gap else np.interp(garment.torso_ease[1], STRAIGHT_EASE, (0.0, 1.0))
        hanging = hull.straightened(low, straight).expand(points, spanned)
    outward = unit_rows(smoothed(normals(points, faces), faces, 4))
    ease, lengthening = fit(body, garment, fields, points, outward)
    fitted = points + outward * (PIN_OFFSET + garment.waistband_offset)
    start = hanging + lengthening + outward * np.minimum(ease, MAX_START_EASE)[:, None]
    rest_shape = hanging + lengthening + outward * ease[:, None]
    fields["drop"] = np.zeros(len(points))
    pins = _pin_weights(body, garment, fields)
    level = Level(rest_shape, start, fitted, pin_weight=pins, weights=weights, faces=faces)
    if garment.drop:
        if garment.gather:  # gathers are finer than the suit
            ring, _ = lowest_border(faces, rest_shape[:, 0], fields["y"])
            matrix, split_faces, parent = split_border(faces, len(points), ring)
            level, sleeve = level.resampled(matrix, split_faces), sleeve[parent]
            fields = {name: matrix @ values for name, values in fields.items()}
        level, fields = add_drop(garment, level, fields, hull)
    above_drop = fields["drop"] == 0
    level.start[above_drop] += 0.7 * (level.rest_shape - level.start)[above_drop]  # most of the ease after all
    sleeve = np.r_[sleeve, np.zeros(len(level.faces) - len(sleeve), bool)]
    return refined(body, garment, level, fields, sleeve, levels)


def refined(body: Body, garment: Garment, coarsest: Level, fields: Fields, sleeve: np.ndarray, levels: int) -> Pattern:
    """Refines a garment by Loop subdivision.

    Args:
        body: in its rest pose.
        garment: its description.
        coarsest: as it was cut.
        fields: (n,) of its vertices, by name.
        sleeve: (F,) whether a face belongs to a sleeve.
        levels: number of subdivisions.
    """
    refined_levels, refine = [coarsest], []
    for _ in range(levels):
        coarse = refined_levels[-1]
        matrix, faces = loop(coarse.faces, len(coarse.rest_shape))
        refine.append(matrix)
        sleeve = np.tile(sleeve, 4)
        refined_levels.append(coarse.resampled(matrix, faces))
        fields = {name: matrix @ values for name, values in fields.items()}
    return Pattern(body, garment, refined_levels, refine, fields, sleeve)


def fit(
    body: Body, garment: Garment, fields: Fields, points: np.ndarray, outward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Computes how a garment's pattern differs from the suit that it is cut from.

    Args:
        body: in its rest pose.
        garment: to be cut.
        fields: attributes (n,) of the vertices by name, see `suit_fields`.
        points: (n,3) vertices of the suit, metres.
        outward: (n,3) their unit normals.

    Returns:
        The ease (n,), metres along the normals, and the displacement (n,3), metres, that lengthens trunk and limbs.
    """
    down, lengthening = np.array([0.0, -1.0, 0.0]), np.zeros_like(points)
    if garment.kind == "top":
        up = (fields["y"] - body.heights["crotch"]) / (body.heights["neck"] - body.heights["crotch"])
        arm, on_arm = np.maximum(fields["armL"], fields["armR"]), np.clip(arm_share(fields), 0, 1)
        trunk_ease, arm_ease = np.interp(up, TORSO_AT, garment.torso_ease), np.interp(arm, ARM_AT, garment.arm_ease)
        ease = trunk_ease * (1 - on_arm) + arm_ease * on_arm
        lengthening = lengthening + down * (np.clip(1 - up, 0, 1) * (1 - on_arm) * garment.slack)[:, None]
        for side in "LR":
            axis = body.joints[f"wrist.{side}"] - body.joints[f"upperarm01.{side}"]
            share = np.clip(fields[f"arm{side}"], 0, 2) / 2 * np.clip(fields[f"arm_share{side}"], 0, 1)
            lengthening = lengthening + (share * garment.sleeve_slack)[:, None] * axis / np.linalg.norm(axis)
        return ease, lengthening
    leg = np.where(fields["x"] > 0, fields["legL"], fields["legR"])
    ease = np.interp(leg, LEG_AT, garment.leg_ease)
    if garment.kind == "trousers":
        lengthening = lengthening + down * (np.clip(leg, 0, 2) / 2 * garment.leg_slack)[:, None]
        inner = outward[:, 0] * np.sign(points[:, 0]) < -0.3
        room = np.maximum(np.abs(points[:, 0]) - 0.004, 0)
        ease = np.where(inner, np.minimum(ease, room), ease)  # the legs of a wide pattern must not cross
    return ease, lengthening


def _pin_weights(body: Body, garment: Garment, fields: Fields) -> np.ndarray:
    """Returns how firmly each vertex (n,) of a garment is pinned to the body, in [0,1].

    Pinned are waistband and cuffs; of tops the neckline, cuffs and hem, what is tucked in, and what a belt holds. Each
    pin fades within a few centimetres.
    """
    arm, leg = np.maximum(fields["armL"], fields["armR"]), np.where(fields["x"] > 0, fields["legL"], fields["legR"])
    if garment.kind != "top":
        waist = np.clip(1 - (body.heights["waist"] + garment.waist - fields["y"]) / 0.035, 0, 1)
        cuff = np.clip((leg - (garment.leg_end - 0.05)) / 0.04, 0, 1) * garment.cuff_pin * (garment.kind == "trousers")
        return np.maximum(waist, cuff)
    is_trunk, near_neck = arm_share(fields) < 0.1, fields["y"] > body.heights["neck"] - 0.2
    neckline = np.clip(1 - neck_field(body, garment, fields) / 0.02, 0, 1) * near_neck
    cuff = np.clip((arm - (garment.sleeve_end - 0.07)) / 0.05, 0, 1)
    hem = np.clip(1 - (fields["y"] - hem_height(body, garment)) / 0.03, 0, 1) * is_trunk
    pins = [neckline * garment.neck_pin, cuff * garment.cuff_pin, hem * garment.hem_pin]
    if garment.tuck_height is not None:  # inside a waistband the cloth lies flat
        edge = body.heights["waist"] + garment.tuck_height
        pins.append(0.9 * np.clip((edge + 0.03 - fields["y"]) / 0.02, 0, 1))
    if garment.belt_height is not None:
        from_belt = np.abs(fields["y"] - body.heights["waist"] - garment.belt_height)
        pins.append(0.95 * np.clip(1 - (from_belt - BELT) / BELT_FADE, 0, 1) * is_trunk)
    return np.max(pins, axis=0)
