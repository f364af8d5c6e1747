"""Hair styles: where hair grows, in which direction it is combed, and its length."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relight.figures.body import makehuman
from relight.figures.body.motion import Motion
from relight.figures.body.shape import Body
from relight.figures.drape.colliders import Collider
from relight.figures.draw.hairstyles import Comb
from relight.figures.dye.skin import above_hairline, skull_centre
from relight.figures.surfaces import face_normals, normals, unit_rows
from relight.figures.texture import random_numbers, smoothstep

WHORL = np.array([0.12, 0.80, -0.59])  # direction from the head's centre to where short hair parts in all directions
TAIL = np.array([0.0, 0.30, -0.95])  # direction in which tied hair leaves the head: back and up
TIE_DISTANCE = 0.004  # metres from the skin to the tie


@dataclass(frozen=True)
class Head:
    """A posed head, on which hair grows.

    Attributes:
        motion: how the body moves from its rest pose into the pose.
        below: posed skin and clothes, on which hair lies.
        seed: random seed of each strand.
        fine: whether all strands grow, else fewer, wider ones.
    """

    motion: Motion
    below: Collider
    seed: int
    fine: bool


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

    def headings(self, direction: np.ndarray, lift: float) -> np.ndarray:
        """Returns the directions (n,3) in which hair leaves the skin that is combed in given ones, (n,3), posed.

        `lift` is as in `Comb`: where it is 0, hair lies along the skin.
        """
        along_skin = unit_rows(direction - (direction * self.normals).sum(1, keepdims=True) * self.normals)
        return along_skin + lift * (0.5 + self.random[:, :1]) * self.normals


def head_centre(body: Body) -> np.ndarray:
    """Returns the centre (3,) of the skull in the rest pose, metres; it is found from the eyes."""
    return skull_centre(body.vertices[makehuman.EYES["L"]].mean(0))


def scalp_roots(points: np.ndarray) -> np.ndarray:
    """Returns the density (n,) of hair at points (n,3) of the base head, in [0,1]; it is thinner near the hairline."""
    return np.clip(above_hairline(points) / 0.08, 0, 1)


def below_hat(points: np.ndarray) -> np.ndarray:
    """Returns the density (n,) of hair at points (n,3) of the base head, in [0,1], where a hat leaves it free.

    A hat covers what is more than 2 cm above the eyes.
    """
    eye = makehuman.base().vertices[makehuman.EYES["L"]].mean(0)
    return scalp_roots(points) * (points[:, 1] < eye[1] + 0.02)


def plant_roots(head: Head, count: int, stream: int, share: Callable[[np.ndarray], np.ndarray]) -> Roots:
    """Samples up to `count` roots, evenly over the skin where hair grows.

    Args:
        head: where they grow.
        count: number of samples, of which those are dropped where hair is thin.
        stream: tells the random numbers apart from those of other hair on the head.
        share: the density of hair in [0,1] at points (n,3) of the base body.
    """
    motion = head.motion
    faces, base, posed = makehuman.base().faces["body"], makehuman.base().vertices, motion.posed_skin
    faces = faces[share(base[faces].reshape(-1, 3)).reshape(-1, 3).max(1) > 0]
    area = np.linalg.norm(face_normals(posed, faces), axis=1)
    area_up_to = np.cumsum(area) / area.sum()
    random = random_numbers(count, 8, head.seed + stream)
    # Stratified: one sample in each of `count` equal parts of the area, uniform on its face.
    face = np.minimum(np.searchsorted(area_up_to, (np.arange(count) + random[:, 0]) / count), len(faces) - 1)
    chosen = faces[face]
    a, b = np.sqrt(random[:, 1]), random[:, 2]
    weights = np.stack([1 - a, a * (1 - b), a * b], -1)

    def at(values: np.ndarray) -> np.ndarray:
        return np.einsum("nk,nkd->nd", weights, values[chosen])

    point = at(base)
    grows = share(point) > random[:, 3]
    chosen, weights = chosen[grows], weights[grows]
    return Roots(
        points=at(posed),
        normals=unit_rows(at(normals(posed, makehuman.base().faces["body"]))),
        sides=unit_rows(at(motion.body.skin) - head_centre(motion.body)),
        rim=np.clip(above_hairline(point[grows]) / 0.35, 0, 1),
        random=random[grows, 4:],
    )


def ramp(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """Returns the smoothstep of values: 0 below `low`, 1 above `high`, and a cubic between."""
    return smoothstep(np.clip((value - low) / (high - low), 0, 1))


def comb_directions(comb: Comb, roots: Roots) -> tuple[np.ndarray, np.ndarray]:
    """Combs and cuts guides.

    Directions are sums of left or right (away from the parting), down and ahead, weighted by where the root is. All
    weights are set by eye.

    Args:
        comb: the style.
        roots: roots of the n guides.

    Returns:
        The direction (n,3) of each guide in the head's rest frame, of any length, and the guide's length (n,), metres.
    """
    x, y, z = roots.sides.T
    azimuth = np.arctan2(x, z)
    top = ramp(y, 0.25, 0.75)[:, None]  # 1 on top of the head, 0 at its sides
    front = (ramp(z, 0.05, 0.55) * ramp(y, 0.15, 0.45))[:, None]  # 1 above the forehead
    behind = ramp(-z, -0.1, 0.5)  # 1 at the back, where there is no parting
    sideways = np.where(azimuth > comb.part, 1.0, -1.0) * (1 - behind) + np.clip(3 * x, -1, 1) * behind
    aside, down, ahead = np.eye(3)[0] * sideways[:, None], np.array([0.0, -1, 0]), np.array([0.0, 0, 1])
    from_whorl = unit_rows(roots.sides - WHORL, 0.15) + 0.5 * (1 - top) * down
    if comb.direction == "forward":
        direction = from_whorl + 0.4 * top * aside * front
    elif comb.direction == "aside":
        direction = from_whorl * (1 - front) + top * (aside + 0.25 * ahead)
    elif comb.direction == "back":
        direction = top * (0.2 * aside - ahead) + (1 - top) * (down - 0.7 * ahead) + front * np.array([0.0, 1.6, 0])
    elif comb.direction == "out":
        direction = 2 * roots.random[:, :3] - 1
    else:
        on_top = 1.4 * aside + 0.3 * down - 0.8 * ahead * behind[:, None]
        at_sides = down + 0.25 * aside - 0.25 * ahead * (1 - front)
        at_front = 1.6 * aside - 0.7 * ahead - 0.3 * down
        direction = top * on_top + (1 - top) * at_sides + front * at_front
    length = comb.length * (comb.sides + (1 - comb.sides) * top[:, 0]) * (0.82 + 0.3 * roots.random[:, 0])
    if comb.fringe:
        in_fringe = front[:, 0] * (np.abs(azimuth) < 0.75 * comb.fringe + 0.12) > 0.3
        direction = np.where(in_fringe[:, None], 1.1 * ahead + 0.35 * aside + 0.4 * down, direction)
        length = np.where(in_fringe, 0.050 + 0.055 * ramp(y, 0.4, 0.95), length)
    elif comb.direction == "down":
        length = length + 0.11 * ramp(y, -0.5, 0.9)  # tips end at one height
    if comb.length < 0.06:  # short hair is shorter still at the hairline
        length = length * (0.4 + 0.6 * roots.rim)
    return direction + 0.14 * (2 * roots.random[:, 1:] - 1), length


def tie_point(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Returns the point (3,) where hair is tied at the back of the posed head, and the direction (3,) of the tail."""
    centre = head_centre(motion.body)
    head = motion.body.skin[motion.body.skin[:, 1] > centre[1] - 0.1] - centre
    reach = (head @ TAIL).max()  # metres from the centre to the skin
    transform = motion.bone("head")
    rotation, shift = transform[:, :3], transform[:, 3]
    return rotation @ (centre + TAIL * (reach + TIE_DISTANCE)) + shift, rotation @ TAIL
