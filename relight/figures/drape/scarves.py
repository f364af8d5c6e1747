"""Scarves: pleated ribbons laid around the neck of the posed and dressed figure, then draped there."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from relight.figures.body.motion import Motion
from relight.figures.catalogue.schema import entries
from relight.figures.cut.level import Level
from relight.figures.cut.patterns import Pattern, refined
from relight.figures.drape.collars import VERTICAL, Neck, neck_of
from relight.figures.drape.colliders import Collider
from relight.figures.draw.garments import Garment
from relight.figures.surfaces import grid_faces, unit_rows

EDGE = 0.025  # metres between the vertices of the coarsest ribbon
PLEAT = 0.42  # width of the pleated ribbon over that of the flat one
LAYER = 0.032  # distance of each turn from the one below it, metres
RAY_START = 1.5  # metres in front of the neck, before every figure
BEARINGS = 72  # directions in which the neck is measured
NECK_RAYS = 0.14  # metres from its middle where the rays toward it start
NECK_RADII = (0.05, 0.115)  # least and largest radius that is taken for the neck's, metres
RING_STEP = 4.0  # degrees between the points of the turns around the neck
RING_DISTANCE = 0.024  # metres from neck and collars to the innermost turn


@dataclass(frozen=True)
class Wrap:
    """How a scarf is worn.

    Attributes:
        start: bearing at which the first end reaches the neck, degrees from the front to the figure's left.
        turn: degrees that the ribbon then runs around the neck, to the figure's right.
        ends: metres that hang down, right and left.
        at: metres from the middle where each end hangs.
        height: metres of the turns above the base of the neck.
        width: metres of the flat ribbon.
    """

    start: float
    turn: float
    ends: tuple[float, float]
    at: tuple[float, float]
    height: float
    width: float


def _outline(surface: Collider, neck: Neck) -> np.ndarray:
    """Returns the radii (BEARINGS,) of the dressed neck about its base, metres, from the front to the left."""
    angle = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    outward = np.outer(np.sin(angle), neck.left) + np.outer(np.cos(angle), neck.forward)
    low, high = NECK_RADII
    radius = np.full(BEARINGS, low)
    for height in (0.03, 0.045, 0.06):  # the widest of three heights counts
        origin = neck.base + height * neck.up + NECK_RAYS * outward
        radius = np.maximum(radius, NECK_RAYS - np.minimum(surface.raycast(origin, -outward)[1], 0.09))
    return gaussian_filter1d(np.minimum(radius, high), 3, mode="wrap")


def _drop_line(surface: Collider, neck: Neck, aside: float, height: float, length: float, lift: float) -> np.ndarray:
    """Lays a line (m,3) down the front of a figure, at a distance of `lift`.

    It begins `aside` and `height` metres to the left of and above the base of the neck. It has 15 % more height than
    its length, since it is cut later. Where rays miss the figure, it hangs straight; if all do, 0.1 m before the neck.
    """
    down = np.arange(0.0, 1.15 * length, 0.01)
    line = neck.base + aside * neck.aside + (height - down)[:, None] * VERTICAL
    ahead = RAY_START - surface.raycast(line + RAY_START * neck.ahead, -neck.ahead)[1]
    reached = np.isfinite(ahead)
    ahead = np.interp(down, down[reached], ahead[reached]) if reached.any() else np.full_like(down, 0.1)
    ahead = np.maximum(gaussian_filter1d(ahead, 4, mode="nearest"), ahead)
    return line + (ahead + lift)[:, None] * neck.ahead


def _centre_line(wrap: Wrap, surface: Collider, neck: Neck) -> tuple[np.ndarray, np.ndarray]:
    """Lays the centre line of a ribbon around the neck, with both ends down the front.

    Returns its points (n,3), every EDGE, and the unit directions (n,3) away from the figure there.
    """
    angle = np.radians(wrap.start - np.arange(0, wrap.turn + 1, RING_STEP))
    layers = LAYER * np.abs(angle - angle[0]) / (2 * np.pi)  # each turn lies on the one before
    bearings = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    radius = np.interp(angle, bearings, _outline(surface, neck), period=2 * np.pi) + RING_DISTANCE + layers
    outward = np.outer(np.sin(angle), neck.left) + np.outer(np.cos(angle), neck.forward)
    ring = neck.base + wrap.height * neck.up + outward * radius[:, None]
    # The ends hang from the first and the last point of the ring, the second one over the first.
    ends = [
        _drop_line(surface, neck, aside, (ring[k] - neck.base) @ VERTICAL - 0.03, length, lift)
        for aside, length, k, lift in zip(wrap.at, wrap.ends, (0, -1), (0.012, 0.036))
    ]
    line = np.concatenate([ends[0][::-1], ring, ends[1]])
    away = np.concatenate([np.tile(neck.ahead, (len(ends[0]), 1)), outward, np.tile(neck.ahead, (len(ends[1]), 1))])
    travel = np.r_[0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]  # metres along the line
    first = travel[len(ends[0])] - wrap.ends[0]
    last = travel[-len(ends[1])] + wrap.ends[1]
    at = np.linspace(first, last, round((last - first) / EDGE) + 1)
    line, away = (
        np.stack([np.interp(at, travel, points[:, axis]) for axis in range(3)], axis=1) for points in (line, away)
    )
    line = gaussian_filter1d(line, 1.2, axis=0, mode="nearest")
    away = gaussian_filter1d(away, 2.0, axis=0, mode="nearest")
    return line, away / np.linalg.norm(away, axis=1, keepdims=True)


def build_scarf(motion: Motion, garment: Garment, surface: Collider, levels: int) -> Pattern:
    """Builds the pattern of a scarf, whose start lies around the posed figure.

    Its rest shape is the flat ribbon (x across, y along, metres). Its skinning weights are 0: it does not move with the
    body.

    Args:
        motion: how the body moves from its rest pose into the pose.
        garment: a scarf; its name chooses how it is worn.
        surface: the dressed figure, posed.
        levels: number of subdivisions.
    """
    wrap = entries("garments", "wraps", Wrap)[garment.name]
    line, away = _centre_line(wrap, surface, neck_of(motion))
    across = unit_rows(np.cross(unit_rows(np.gradient(line, axis=0)), away))
    rows, columns = len(line), round(wrap.width / EDGE) + 1
    column = np.arange(columns) - (columns - 1) / 2  # from the middle
    fold = EDGE * np.sqrt(1 - PLEAT**2) * np.sin(np.pi / 2 * np.arange(columns))  # metres off the figure: 0, 1, 0, -1
    start = line[:, None] + PLEAT * EDGE * column[:, None] * across[:, None] + fold[:, None] * away[:, None]
    x, y = np.meshgrid(EDGE * column, EDGE * (np.arange(rows) - (rows - 1) / 2))
    flat = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    faces = grid_faces(rows, columns)[:, [0, 2, 1]]  # y is upward
    start = start.reshape(-1, 3)
    no_skinning = np.zeros((len(flat), 1))
    coarsest = Level(flat, start, fitted=start, pin_weight=np.zeros(len(flat)), weights=no_skinning, faces=faces)
    no_sleeves = np.zeros(len(faces), bool)
    return refined(motion.body, garment, coarsest, {"drop": np.ones(len(flat))}, no_sleeves, levels)
