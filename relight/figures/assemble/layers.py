"""Layers of clothes: removes what a garment covers, and pushes back under it what comes through."""

import numpy as np

from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.drape.dress import DrapedGarment
from relight.figures.surfaces import Surface, border_distance, smoothed

DEEP = 0.006  # depth under a garment at which a hidden point must also be out of sight, metres
DIRECTIONS = 64  # of the rays, over the whole sphere
REST_RANGE = 0.035  # search range of a garment on the rest pose, metres
POSED_RANGE = 0.07  # search range of a garment as it hangs, metres
FITTED_DEPTHS = (-0.03, 0.015)  # signed distances from the fitted garment, metres, between which a point lies under it
MAX_HEIGHT = 0.012  # metres above the garment as it hangs up to which a point counts as under it
PUSH_RANGE = 0.02  # metres by which a point that is pushed back may be outside


def hidden_under(
    worn: DrapedGarment, rest: np.ndarray, posed: np.ndarray, normal: np.ndarray, rings: int, figure: Collider
) -> np.ndarray:
    """Returns which points (n,) a garment always hides, so that they can be removed.

    A point must lie under the garment both on the rest pose and as the garment hangs: a sleeve may slide up an arm,
    and a hand may come to rest on the cloth. Where the garment hangs off it, no ray from it may leave the figure
    either: one sees far into an open jacket or an armhole.

    Args:
        worn: the garment; its drop hangs free, so nothing is hidden behind it.
        rest: (n,3) the points on the rest pose, metres.
        posed: (n,3) the same, posed.
        normal: (n,3) their unit normals, posed.
        rings: edges by which a covering face must be away from the garment's border.
        figure: all surfaces of the figure.
    """
    fitted, (draped, faces) = worn.pattern.levels[-1].fitted, worn.surface
    inner = (border_distance(fitted, faces, rings + 1) > rings) & (worn.pattern.fields["drop"] < 0.02)
    face, distance, _ = signed_distance(rest, Collider.at_rest(fitted, faces), REST_RANGE)
    deepest, highest = FITTED_DEPTHS
    hidden = (face >= 0) & (distance > deepest) & (distance < highest) & inner[faces[face]].all(1)
    face, distance, _ = signed_distance(posed, Collider.at_rest(draped, faces), POSED_RANGE)
    hidden &= (face >= 0) & (distance < MAX_HEIGHT) & inner[faces[face]].all(1)
    deep = np.flatnonzero(hidden & (distance < -DEEP))
    hidden[deep] = ~_sees_outside(posed[deep], normal[deep], figure)
    return hidden


def _sees_outside(points: np.ndarray, normal: np.ndarray, figure: Collider) -> np.ndarray:
    """Returns from which points (n,3), with unit normals (n,3), a ray in some direction leaves the figure."""
    index = np.arange(DIRECTIONS) + 0.5  # a Fibonacci spiral about the vertical
    up, turn = 1 - 2 * index / DIRECTIONS, np.pi * (1 + np.sqrt(5)) * index
    directions = np.stack([np.sqrt(1 - up**2) * np.cos(turn), up, np.sqrt(1 - up**2) * np.sin(turn)], axis=1)
    outside, start = np.zeros(len(points), bool), points + 0.5 * DEEP * normal
    for direction in directions:
        pending = np.flatnonzero(~outside & (normal @ direction > 0.1))  # above their surface, and no ray left yet
        face, _ = figure.raycast(start[pending], direction)
        outside[pending] = face < 0
    return outside


def push_under(
    lower: Surface, garment: Surface, gap: float, movable: np.ndarray | None = None, facing: np.ndarray | None = None
) -> np.ndarray:
    """Moves points that come through a garment by less than PUSH_RANGE back under it.

    Args:
        lower: the n points and the faces between them, metres.
        garment: vertices and faces of the upper surface.
        gap: metres to the garment afterwards.
        movable: (n,) points that may move; all where it is None.
        facing: (n,3) unit normals of the points. If given, points before cloth that faces against them stay: they are
            outside of the inner side of a fold.

    Returns:
        The points (n,3), and with them their neighbours, smoothly.
    """
    points, faces = lower
    movable = np.ones(len(points), bool) if movable is None else movable
    vertices, garment_faces = garment
    surface = Collider.at_rest(vertices, garment_faces)
    inner = np.all(border_distance(vertices, garment_faces, 2)[garment_faces] > 0, axis=1)
    for _ in range(3):
        face, distance, normal = signed_distance(points, surface, PUSH_RANGE)
        outside = movable & (face >= 0) & (distance > -gap) & inner[face]
        if facing is not None:
            outside &= np.einsum("nd,nd->n", normal, facing) > 0
        if not outside.any():
            break
        move = np.where(outside[:, None], -(distance + gap)[:, None] * normal, 0)
        neighbour_move = np.where(movable[:, None], smoothed(move, faces, 2), 0)
        points = points + np.where(outside[:, None], move, neighbour_move)
    return points
