"""Cuts garments from the suit around the body; their drops, which hang free of the body, are added later."""

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.sparse as sparse

from relight.figures.body import makehuman
from relight.figures.body.shape import Body
from relight.figures.cut.suit import Fields, arm_share
from relight.figures.draw.garments import Garment
from relight.figures.surfaces import clip, compacted, split
from relight.meshes.geometry import connected_parts

SLEEVELESS = 0.06  # position along the arm, 0 shoulder to 1 elbow, where a sleeveless garment is cut
NECK_CENTRE = np.array([0.0, 0.03, 0.035])  # of the neck opening, from the joint at the base of the neck, metres
FAR = 1.0  # value of a field where its cut removes nothing
TRUNK = 0.35  # share of arm bones in the skinning, below which a vertex belongs to the trunk


def neck_field(body: Body, garment: Garment, fields: Fields) -> np.ndarray:
    """Returns the metres (n,) outside the neck opening of a garment, negative within it.

    The opening is an ellipsoid, open at the top, with a V below it in front. Distances are exact across the opening,
    and scaled along its other axes.

    Args:
        body: in its rest pose.
        garment: with the shape of its neck opening.
        fields: of n vertices, see `suit_fields`.
    """
    centre = body.joints["neck01"] + NECK_CENTRE
    wide, high, deep = garment.neck
    across, ahead = fields["x"] / wide, (fields["z"] - centre[2]) / deep
    below = np.minimum(fields["y"] - centre[1], 0) / high
    radius = np.sqrt(across**2 + ahead**2 + below**2)
    outside = (radius - 1) * wide
    if garment.v_depth:
        half_width = 0.8 * wide * (fields["y"] - centre[1] + high + garment.v_depth) / (high + garment.v_depth)
        outside_v = np.minimum(outside, np.abs(fields["x"]) - half_width)
        outside = np.where(fields["z"] > centre[2], outside_v, outside)
    return np.where(arm_share(fields) > 0.3, FAR, outside)


def _armhole_field(body: Body, garment: Garment, fields: Fields, side: str) -> np.ndarray:
    """Returns the metres (n,) outside the armhole of a sleeveless garment: a ball that leaves a strap at the neck."""
    centre, sign = body.joints[f"upperarm01.{side}"], 1 if side == "L" else -1
    inward = np.minimum(sign * (fields["x"] - centre[0]), 0)  # all that is outside the shoulder is within the armhole
    radius = np.sqrt(inward**2 + (0.75 * (fields["y"] - centre[1])) ** 2 + (0.9 * (fields["z"] - centre[2])) ** 2)
    return np.where(sign * fields["x"] > 0, radius - garment.armhole, FAR)


def _sleeve_field(fields: Fields, body: Body, garment: Garment, side: str) -> np.ndarray:
    """Returns the field (n,) by which a sleeve is cut off; vertices that hardly move with the arm belong to the trunk.

    It is positive where the garment is: above the end of the sleeve, outside the armhole, and on the other side.
    """
    end = SLEEVELESS if garment.armhole else garment.sleeve_end
    trunk_bonus = 8 * np.clip(TRUNK - fields[f"arm_share{side}"], 0, 1)  # outweighs any position along the arm
    within = end - fields[f"arm{side}"] + trunk_bonus
    if garment.armhole:  # two cuts would leave slivers between them
        within = np.minimum(within, _armhole_field(body, garment, fields, side))
    return np.where((fields["x"] > 0) == (side == "L"), within, FAR)


def _front_field(fields: Fields, body: Body, garment: Garment) -> np.ndarray:
    """Returns the metres (n,) from the gap of an open front, which widens toward the neck; FAR on the back."""
    neck, chest = body.joints["neck01"], body.heights["hip"] + 0.2
    widening = 1 + 0.9 * np.clip((fields["y"] - chest) / (neck[1] - chest), 0, 1)
    return np.where(fields["z"] > neck[2] + 0.02, np.abs(fields["x"]) - garment.front_gap * widening, FAR)


def cuts(body: Body, garment: Garment) -> list[Callable[[Fields], np.ndarray]]:
    """Returns how a garment is cut from the suit.

    Args:
        body: in its rest pose.
        garment: to be cut.

    Returns:
        Functions of the suit's fields; keeping where each is positive, one after the other, leaves the garment.
    """

    def above_hem(fields: Fields) -> np.ndarray:
        return fields["y"] - hem_height(body, garment)

    def below_waist(fields: Fields) -> np.ndarray:
        return body.heights["waist"] + garment.waist - fields["y"]

    def above_cuffs(fields: Fields) -> np.ndarray:
        """Returns the distance (n,) along the leg to the end of trousers: 1 is that from hip to knee."""
        return garment.leg_end - np.where(fields["x"] > 0, fields["legL"], fields["legR"])

    if garment.kind == "top":
        sleeves = [partial(_sleeve_field, body=body, garment=garment, side=side) for side in "LR"]
        front = [partial(_front_field, body=body, garment=garment)] if garment.front_gap else []
        return [above_hem, partial(neck_field, body, garment), *sleeves, *front]
    return [below_waist, above_cuffs if garment.kind == "trousers" else above_hem]


def hem_height(body: Body, garment: Garment) -> float:
    """Returns the height on the rest pose, metres, down to which a garment is cut; its drop begins there."""
    return body.heights["crotch"] + garment.hem if garment.seam is None else body.heights["waist"] + garment.seam


def cut_from_suit(body: Body, garment: Garment, suit: Fields) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Cuts a garment from the suit that follows the body, without its drop: the cloth that hangs free of the body.

    Args:
        body: in its rest pose.
        garment: to be cut.
        suit: fields of the suit, see `suit_fields`.

    Returns:
        The matrix from the suit's vertices to the garment's, its faces (F,3), and which of them (F,) are of sleeves.
    """
    faces = makehuman.base().faces["helper-tights"] - makehuman.TIGHTS.start
    matrix = sparse.identity(len(body.tights), format="csr")
    for cut in cuts(body, garment):
        matrix, faces = clip(matrix, faces, cut({name: matrix @ values for name, values in suit.items()}))
    piece = connected_parts(faces, matrix.shape[0])  # a cut may leave small ones beside the largest
    matrix, faces = compacted(matrix, faces[piece == np.bincount(piece).argmax()])
    sleeve = np.zeros(len(faces), bool)
    if garment.kind == "top":  # edges along the armhole, where the panels of sleeve and body meet
        matrix, faces, sleeve = split(matrix, faces, matrix @ arm_share(suit) - 0.5)
    return matrix, faces, sleeve
