"""Hair styles: where hair grows, in which direction it is combed, and its length."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from relight.figures.body import makehuman
from relight.figures.body.person import Body
from relight.figures.body.skin import above_hairline
from relight.figures.pose.motion import Motion
from relight.figures.surfaces import normals
from relight.figures.texture import lattice

WHORL = np.array([0.12, 0.80, -0.59])  # from the head's centre: where short hair parts in all directions


@dataclass(frozen=True)
class Comb:
    """How hair is combed and cut.

    Attributes:
        count: number of guides.
        length: metres on the top.
        strands: per guide.
        sides: length at the sides over that on the top.
        width: of a strand, metres.
        direction: in which the top is combed.
        fringe: share of the front that falls on the forehead.
        part: azimuth of the parting.
        lift: from 0 (lies flat) to 1 (stands up).
        weight: how soon hair falls.
        cling: how close it keeps to the head.
        body: metres of the topmost strand over the skin.
        curl: radius of its turns, metres.
        pitch: metres from one turn to the next.
        clump: how far the strands of a guide draw together at their tips, in [0,1].
        fray: metres by which strands stray.
        wander: how much guides turn at each step.
        roll: radians by which strands are turned about themselves, to either side.
        above: metres over the skin where strands start.
    """

    count: int
    length: float
    strands: int = 10
    sides: float = 1.0
    width: float = 0.0022
    direction: Literal["forward", "aside", "back", "down", "out", "tie"] = "down"
    fringe: float = 0.0
    part: float = 0.0
    lift: float = 0.25
    weight: float = 0.25
    cling: float = 0.0
    body: float = 0.014
    curl: float = 0.0
    pitch: float = 0.08
    clump: float = 0.5
    fray: float = 0.0012
    wander: float = 0.1
    roll: float = 0.3
    above: float = 0.0


@dataclass(frozen=True)
class Roots:
    """Where hair grows.

    Attributes:
        points: (n,3) posed, metres.
        normals: (n,3) of the skin, posed.
        sides: (n,3) unit directions from the head's centre, in its rest frame.
        rim: (n,) from 0 at the hairline to 1 well inside.
        random: (n,4) random numbers in [0,1].
    """

    points: np.ndarray
    normals: np.ndarray
    sides: np.ndarray
    rim: np.ndarray
    random: np.ndarray


def head_centre(body: Body) -> np.ndarray:
    """Returns the centre (3,) of the skull in the rest pose, metres, relative to the eyes."""
    eye = body.vertices[makehuman.EYES["L"]].mean(0)
    return np.array([0.0, eye[1] + 0.028, eye[2] - 0.085])


def scalp_roots(points: np.ndarray) -> np.ndarray:
    """Returns the density (n,) of hair on the scalp, in [0,1]; it is thinner within a centimetre of the hairline."""
    return np.clip(above_hairline(points) / 0.08, 0, 1)


def below_hat(points: np.ndarray) -> np.ndarray:
    """Returns the density (n,) of hair that a hat leaves free, in [0,1]."""
    eye = makehuman.base().vertices[makehuman.EYES["L"]].mean(0)
    return scalp_roots(points) * (points[:, 1] < eye[1] + 0.02)


def plant_roots(
    motion: Motion, count: int, seed: int, share: Callable[[np.ndarray], np.ndarray] = scalp_roots
) -> Roots:
    """Samples up to `count` roots, evenly over the skin where hair grows.

    Args:
        motion: of the body into the pose.
        count: number of samples, of which those are dropped where hair is thin.
        seed: of the samples.
        share: the density of hair in [0,1] at points (n,3) of the base body.
    """
    faces, base, posed = makehuman.base().faces["body"], makehuman.base().vertices, motion.posed_skin
    faces = faces[share(base[faces].reshape(-1, 3)).reshape(-1, 3).max(1) > 0]
    corner = posed[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    total = np.cumsum(area) / area.sum()
    number = np.arange(count)
    random = np.stack([lattice(number, np.full(count, k), seed) for k in range(8)], -1)
    chosen = faces[np.minimum(np.searchsorted(total, (number + random[:, 0]) / count), len(faces) - 1)]
    a, b = np.sqrt(random[:, 1]), random[:, 2]
    weights = np.stack([1 - a, a * (1 - b), a * b], -1)

    def at(values: np.ndarray) -> np.ndarray:
        return np.einsum("nk,nkd->nd", weights, values[chosen])

    point = at(base)
    grows = share(point) > random[:, 3]
    chosen, weights = chosen[grows], weights[grows]
    side, normal = at(motion.body.skin) - head_centre(motion.body), at(normals(posed, makehuman.base().faces["body"]))
    return Roots(
        at(posed),
        normal / np.linalg.norm(normal, axis=1, keepdims=True),
        side / np.linalg.norm(side, axis=1, keepdims=True),
        np.clip(above_hairline(point[grows]) / 0.35, 0, 1),
        random[grows, 4:],
    )


def ramp(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """Returns the smoothstep of values: 0 below `low`, 1 above `high`, and a cubic between."""
    t = np.clip((value - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def comb_directions(comb: Comb, roots: Roots) -> tuple[np.ndarray, np.ndarray]:
    """Returns the direction (n,3) of each guide, in the head's rest frame, and its length (n,) in metres."""
    x, y, z = roots.sides.T
    azimuth = np.arctan2(x, z)
    top = ramp(y, 0.25, 0.75)[:, None]
    front = (ramp(z, 0.05, 0.55) * ramp(y, 0.15, 0.45))[:, None]
    behind = ramp(-z, -0.1, 0.5)  # a parting ends at the crown
    aside = np.where(azimuth > comb.part, 1.0, -1.0) * (1 - behind) + np.clip(3 * x, -1, 1) * behind
    left, down, ahead = np.eye(3)[0] * aside[:, None], np.array([0.0, -1, 0]), np.array([0.0, 0, 1])
    fall = down + 0.25 * left - 0.25 * ahead * (1 - front)
    away = roots.sides - WHORL
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 0.15) + 0.5 * (1 - top) * down
    if comb.direction == "forward":
        direction = away + 0.4 * top * left * front
    elif comb.direction == "aside":
        direction = away * (1 - front) + top * (left + 0.25 * ahead)
    elif comb.direction == "back":
        direction = top * (0.2 * left - ahead) + (1 - top) * (down - 0.7 * ahead) + front * np.array([0.0, 1.6, 0])
    elif comb.direction == "out":
        direction = 2 * roots.random[:, :3] - 1
    else:
        crown = 1.4 * left + 0.3 * down - 0.8 * ahead * behind[:, None]
        direction = top * crown + (1 - top) * fall + front * (1.6 * left - 0.7 * ahead - 0.3 * down)
    length = comb.length * (comb.sides + (1 - comb.sides) * top[:, 0]) * (0.82 + 0.3 * roots.random[:, 0])
    if comb.fringe:
        falls = front[:, 0] * (np.abs(azimuth) < 0.75 * comb.fringe + 0.12) > 0.3
        direction = np.where(falls[:, None], 1.1 * ahead + 0.35 * left + 0.4 * down, direction)
        length = np.where(falls, 0.050 + 0.055 * ramp(y, 0.4, 0.95), length)
    elif comb.direction == "down":
        length = length + 0.11 * ramp(y, -0.5, 0.9)  # tips end at one height
    if comb.length < 0.06:
        length = length * (0.4 + 0.6 * roots.rim)
    return direction + 0.14 * (2 * roots.random[:, 1:] - 1), length


def tie_point(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Returns the point (3,) where hair is tied at the back of the posed head, and the direction (3,) of the tail."""
    centre, backward = head_centre(motion.body), np.array([0.0, 0.30, -0.95])
    behind = motion.body.skin[motion.body.skin[:, 1] > centre[1] - 0.1] - centre
    reach = (behind @ backward).max()
    turn = motion.bone("head")
    return turn[:, :3] @ (centre + backward * (reach + 0.004)) + turn[:, 3], turn[:, :3] @ backward
