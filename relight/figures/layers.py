"""Layers over each other: what a garment covers is left out, and what still comes through is pushed back under it."""

import numpy as np

from relight.figures.colliders import Collider
from relight.figures.surfaces import border_distance, smoothed

DEEP = 0.006  # metres under a garment: what comes through it does not start from there
DIRECTIONS = 64  # over the whole sphere, in which a ray from a covered point may leave the figure


def sided(points: np.ndarray, surface: Collider, far: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The signed distance of points from a surface.

    Args:
        points: (n,3) metres.
        surface: the surface, whose faces turn outward.
        far: metres beyond which nothing is looked for.

    Returns:
        The nearest face (n,), -1 beyond `far`; the distance (n,), positive outside, infinite beyond `far`; the unit
        normal (n,3) of the surface there.
    """
    face, weights = surface.nearest(points, far)
    corner = surface.corner.numpy().reshape(-1, 3)[face]
    base = np.einsum("nk,nkd->nd", weights, surface.after.numpy()[corner])
    normal = np.einsum("nk,nkd->nd", weights, surface.normal.numpy()[corner])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return face, np.where(face >= 0, np.einsum("nd,nd->n", points - base, normal), np.inf), normal


def covered(
    points: np.ndarray,
    now: np.ndarray,
    normal: np.ndarray,
    held: np.ndarray,
    draped: np.ndarray,
    faces: np.ndarray,
    solid: np.ndarray,
    rings: int,
    around: Collider,
) -> np.ndarray:
    """Which points (n,) a garment covers for good, so that they can be left out.

    Both in the rest pose (points (n,3), the garment snug at `held`) and as it hangs (points `now`, the garment
    `draped`), they must lie under it, further than `rings` edges from its border, on faces whose vertices are all
    `solid` (no free-hanging drop): a sleeve may slide up an arm, and a hand may come to rest on the cloth. Where the
    garment hangs off them they must not see out between the surfaces of the figure, `around`, either: an open jacket
    and an armhole let one look far in. normal (n,3): theirs, unit length, now.
    """
    inner = (border_distance(held, faces, rings + 1) > rings) & solid
    face, distance, _ = sided(points, Collider(held, held, faces), 0.035)
    out = (face >= 0) & (np.abs(distance) < 0.03) & (distance < 0.015) & inner[faces[face]].all(1)
    face, distance, _ = sided(now, Collider(draped, draped, faces), 0.07)
    out &= (face >= 0) & (distance < 0.012) & inner[faces[face]].all(1)
    below = np.flatnonzero(out & (distance < -DEEP))
    out[below] = ~sees_out(now[below], normal[below], around)
    return out


def sees_out(points: np.ndarray, normal: np.ndarray, around: Collider) -> np.ndarray:
    """Which points a ray can leave the figure from.

    Args:
        points: (n,3) metres.
        normal: (n,3) unit length.
        around: all surfaces of the figure.

    Returns:
        (n,) whether the ray in one of DIRECTIONS directions meets no surface.
    """
    i = np.arange(DIRECTIONS) + 0.5
    up, turn = 1 - 2 * i / DIRECTIONS, np.pi * (1 + np.sqrt(5)) * i
    directions = np.stack([np.sqrt(1 - up**2) * np.cos(turn), up, np.sqrt(1 - up**2) * np.sin(turn)], axis=1)
    out, start = np.zeros(len(points), bool), points + 0.5 * DEEP * normal
    for direction in directions:
        ask = np.flatnonzero(~out & (normal @ direction > 0.1))
        out[ask] = around.cast(start[ask], np.broadcast_to(direction, (len(ask), 3)))[0] < 0
    return out


def tucked_under(
    points: np.ndarray,
    faces: np.ndarray,
    over: tuple[np.ndarray, np.ndarray],
    gap: float,
    free: np.ndarray,
    facing: np.ndarray | None = None,
) -> np.ndarray:
    """Moves points that come through the garment `over` (vertices, faces) by less than 2 cm back to `gap` under it;
    only where `free` (n,). Outside of cloth that turns against `facing`, the points' unit normals (n,3), is the inside
    of a fold, and what is there stays."""
    surface = Collider(over[0], over[0], over[1])
    inner = (border_distance(over[0], over[1], 2) > 0)[over[1]].all(1)
    for _ in range(3):
        face, distance, normal = sided(points, surface, 0.02)
        through = free & (face >= 0) & (distance > -gap) & inner[face]
        if facing is not None:
            through &= np.einsum("nd,nd->n", normal, facing) > 0
        if not through.any():
            break
        move = np.where(through[:, None], -(distance + gap)[:, None] * normal, 0)
        soft = smoothed(move, faces, 2)
        points = points + np.where(through[:, None], move, np.where(free[:, None], soft, 0))
    return points
