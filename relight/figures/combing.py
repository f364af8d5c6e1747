"""How hair is worn: where locks are rooted in the scalp, which way they are combed, how long they are."""

from dataclasses import dataclass

import numpy as np

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.fabrics import lattice
from relight.figures.poses import Motion
from relight.figures.skin import above_hairline


@dataclass(frozen=True)
class Comb:
    """How hair is worn. count: locks; length: metres on the top; sides: their length over that; width: of a lock,
    metres; way: forward | aside | back | down | out, where the top is combed; fringe: share of the front that falls
    on the forehead; part: azimuth of the parting; lift: 0 lies flat to 1 stands up; weight: how soon it falls;
    cling: how close it keeps to the head; body: metres of the topmost lock over the skin; curl: radius of its turns,
    and pitch: metres from one turn to the next; taper: width at the tip over that in the middle."""

    count: int
    length: float
    sides: float = 1.0
    width: float = 0.011
    way: str = "down"
    fringe: float = 0.0
    part: float = 0.0
    lift: float = 0.25
    weight: float = 0.25
    cling: float = 0.0
    body: float = 0.014
    curl: float = 0.0
    pitch: float = 0.08
    taper: float = 0.25
    above: float = 0.0


@dataclass(frozen=True)
class Roots:
    """Where locks grow: points, normals (n,3) posed; sides (n,3) unit, from the head's centre in its rest frame;
    rim (n,): 0 at the hairline to 1 well inside; pick (n,4) random numbers in [0,1]."""

    points: np.ndarray
    normals: np.ndarray
    sides: np.ndarray
    rim: np.ndarray
    pick: np.ndarray


def head_centre(body: Body) -> np.ndarray:
    eye = body.vertices[makehuman.EYES["L"]].mean(0)
    return np.array([0.0, eye[1] + 0.028, eye[2] - 0.085])


def plant(body: Body, posed: np.ndarray, count: int, seed: int, below_hat: bool = False) -> Roots:
    """`count` roots, even over the part of the scalp that carries hair; `posed` (13380,3) is the skin.

    With below_hat only what a hat leaves free.
    """
    faces = makehuman.base().faces["body"]
    base = makehuman.base().vertices
    above = above_hairline(base[faces].mean(1))
    keep = above > 0.02
    if below_hat:
        keep &= base[faces].mean(1)[:, 1] < base[makehuman.EYES["L"]].mean(0)[1] + 0.02
    grown = faces[keep]
    corner = posed[grown]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    total = np.cumsum(area) / area.sum()
    number = np.arange(count)
    random = np.stack([lattice(number, np.full(count, k), seed) for k in range(7)], -1)
    chosen = np.minimum(np.searchsorted(total, (number + random[:, 0]) / count), len(grown) - 1)
    a, b = np.sqrt(random[:, 1]), random[:, 2]
    weights = np.stack([1 - a, a * (1 - b), a * b], -1)
    flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    side = np.einsum("nk,nkd->nd", weights, body.skin[grown[chosen]]) - head_centre(body)
    return Roots(
        np.einsum("nk,nkd->nd", weights, corner[chosen]),
        flat[chosen],
        side / np.linalg.norm(side, axis=1, keepdims=True),
        np.clip(above[keep][chosen] / 0.35, 0, 1),
        random[:, 3:],
    )


def ramp(value: np.ndarray, low: float, high: float) -> np.ndarray:
    t = np.clip((value - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def combed(comb: Comb, roots: Roots) -> tuple[np.ndarray, np.ndarray]:
    """The way (n,3) each lock is combed, in the head's rest frame, and its length (n,) in metres."""
    x, y, z = roots.sides.T
    azimuth = np.arctan2(x, z)
    top = ramp(y, 0.25, 0.75)[:, None]
    front = (ramp(z, 0.05, 0.55) * ramp(y, 0.15, 0.45))[:, None]
    aside = np.where(azimuth > comb.part, 1.0, -1.0)
    left, down, ahead = np.eye(3)[0] * aside[:, None], np.array([0.0, -1, 0]), np.array([0.0, 0, 1])
    fall = down + 0.25 * left - 0.25 * ahead * (1 - front)
    if comb.way == "forward":
        way = top * (ahead + 0.25 * left) + (1 - top) * (down - 0.3 * ahead)
    elif comb.way == "aside":
        way = top * (left + 0.25 * ahead) + (1 - top) * (down - 0.3 * ahead)
    elif comb.way == "back":
        way = top * (0.2 * left - ahead) + (1 - top) * (down - 0.7 * ahead) + front * np.array([0.0, 1.6, 0])
    elif comb.way == "out":
        way = 2 * roots.pick[:, :3] - 1
    else:
        way = top * (1.4 * left + 0.3 * down) + (1 - top) * fall + front * (1.6 * left - 0.7 * ahead - 0.3 * down)
    length = comb.length * (comb.sides + (1 - comb.sides) * top[:, 0]) * (0.82 + 0.3 * roots.pick[:, 0])
    if comb.fringe:
        falls = front[:, 0] * (np.abs(azimuth) < 0.75 * comb.fringe + 0.12) > 0.3
        way = np.where(falls[:, None], 1.1 * ahead + 0.35 * left + 0.4 * down, way)
        length = np.where(falls, 0.050 + 0.055 * ramp(y, 0.4, 0.95), length)
    elif comb.way == "down":
        length = length + 0.11 * ramp(y, -0.5, 0.9)  # tips end at one height
    if comb.length < 0.06:
        length = length * (0.4 + 0.6 * roots.rim)
    return way + 0.14 * (2 * roots.pick[:, 1:] - 1), length


def tie_point(body: Body, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Where hair is tied at the back of the head, posed, and the way (3,) it leaves the head there."""
    centre, backward = head_centre(body), np.array([0.0, 0.30, -0.95])
    behind = body.skin[body.skin[:, 1] > centre[1] - 0.1] - centre
    reach = (behind @ backward).max()
    turn = motion.transforms[-1, motion.bones["head"]]
    return turn[:, :3] @ (centre + backward * (reach + 0.004)) + turn[:, 3], turn[:, :3] @ backward
