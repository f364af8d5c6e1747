"""Grows guides of hair out of the scalp: they are combed, fall, and lie on head and shoulders. Strands follow them."""

from dataclasses import replace

import numpy as np

from relight.figures.assemble.hair import combing
from relight.figures.assemble.hair.combing import Head, Roots
from relight.figures.assemble.hair.strands import Lines, Strip, ribbons, spread_strands
from relight.figures.body.motion import Motion
from relight.figures.drape.colliders import signed_distance
from relight.figures.draw.hairstyles import Comb
from relight.figures.surfaces import unit_rows
from relight.figures.texture import noise, random_numbers

CONTACT_RANGE = 0.08  # search range of the surface below a guide, metres
CLING_RANGE = 0.02  # distance from that surface up to which a guide clings to it with full strength, metres
ROLL = 0.3  # radians by which strands are turned about themselves, to either side
MAX_PUSH = 0.03  # metres by which one step may be moved away from that surface, or toward it


def grow_guides(
    head: Head, comb: Comb, roots: Roots, heading: np.ndarray, length: np.ndarray, steps: int, seed: int, aside: bool
) -> Lines:
    """Grows guides step by step: each step follows the last one, falls, and slides along the surface below.

    Args:
        head: with the skin and clothes on which they lie.
        comb: weight, cling and wander of the hair.
        roots: roots of the n guides.
        heading: (n,3) first directions, posed.
        length: (n,) metres.
        steps: per guide.
        seed: random seed of their wandering.
        aside: whether they keep out of the face, and do not spread on the shoulders.

    Returns:
        The guides, of steps + 1 points, with unit normals of the surface below.
    """
    n = len(roots.points)
    layer = comb.body * (0.85 + 0.15 * roots.random[:, 3]) * (0.35 + 0.65 * roots.rim)
    layer = 0.002 + np.minimum(layer, 0.25 * length)  # metres over the skin; short hair lies flat
    heading = unit_rows(heading)
    rise = comb.above * np.sqrt(roots.rim * (2 - roots.rim))  # nothing at the hairline
    depth = np.minimum(0.002, 0.1 * length)  # of the roots in the skin
    point, normal = roots.points + (rise - depth)[:, None] * roots.normals, roots.normals
    points, normals_below = [point], [normal]
    step = (length / steps)[:, None]
    for k in range(1, steps + 1):
        wander = np.stack([noise(roots.sides[:, c] * 9 + c, np.full(n, 0.7 * k), seed + c) for c in range(3)], -1) - 0.5
        fall = [0, -comb.weight * min(1.0, 2.5 * k / steps), 0]
        heading = unit_rows(heading + fall + comb.wander * wander)
        goal = point + step * heading
        face, distance, facing = signed_distance(goal, head.below, CONTACT_RANGE)
        is_close = face >= 0
        normal = np.where(is_close[:, None], facing, normal)
        wanted_distance = layer * min(1.0, k / 2.5)
        push = np.where(is_close, wanted_distance - np.where(is_close, distance, 0), 0)  # outward where positive
        cling = comb.cling * (1 - combing.ramp(distance, CLING_RANGE, CONTACT_RANGE))
        push = np.where(push > 0, push, cling * push)
        goal = goal + np.clip(push, -MAX_PUSH, MAX_PUSH)[:, None] * normal
        if aside:
            goal = _moved_aside(head.motion, point, goal)
        heading = unit_rows(goal - point)
        point = point + step * heading
        points.append(point)
        normals_below.append(normal)
    normals = np.stack(normals_below, 1)
    for _ in range(2):
        normals[:, 1:-1] = (normals[:, :-2] + 2 * normals[:, 1:-1] + normals[:, 2:]) / 4
    return np.stack(points, 1), normals


def _moved_aside(motion: Motion, points: np.ndarray, next_points: np.ndarray) -> np.ndarray:
    """Moves hair from the face to its sides, and keeps it from spreading on the shoulders.

    Returns other next points for given points (n,3) and their next ones (n,3), all posed.
    """
    centre, head = combing.head_centre(motion.body), motion.bone("head")
    cheek = motion.body.skin[np.abs(motion.body.skin[:, 1] - centre[1] + 0.05) < 0.02]
    half_width = 0.90 * cheek[cheek[:, 2] > centre[2] + 0.03, 0].max()  # of the face, metres
    after, before = ((posed - head[:, 3]) @ head[:, :3] - centre for posed in (next_points, points))  # rest frame
    side = np.where(after[:, 0] > 0, 1.0, -1.0)
    in_face = combing.ramp(after[:, 2], 0.02, 0.06) * combing.ramp(-after[:, 1], -0.03, 0.02)
    outward = 0.6 * in_face * np.maximum(half_width - np.abs(after[:, 0]), 0)
    on_shoulders = combing.ramp(-after[:, 1], 0.09, 0.14)
    inward = 0.75 * on_shoulders * np.maximum((after[:, 0] - before[:, 0]) * side, 0)
    return next_points + ((outward - inward) * side)[:, None] * head[:, 0]


def grow_locks(head: Head, comb: Comb, hat: bool) -> Strip:
    """Grows all strands of a style, or only those that a hat leaves free; a third of them, and wider, if not `fine`."""
    motion, seed, fine = head.motion, head.seed, head.fine
    if not fine:
        comb = replace(comb, count=comb.count // 2, strands=max(2, round(comb.strands / 1.5)), width=1.8 * comb.width)
    share = combing.below_hat if hat else combing.scalp_roots
    guides = combing.plant_roots(head, comb.count, 0, share)
    direction, length = combing.comb_directions(comb, guides)
    direction = direction @ motion.bone("head")[:, :3].T
    goal, _ = combing.tie_point(motion)
    if comb.direction == "tie":
        direction = goal - guides.points
        length = 1.12 * np.linalg.norm(direction, axis=1)
    steps = int(np.clip(np.ceil(length.max() / (0.014 if fine else 0.022)), 5, 18))
    heading, hangs = guides.headings(direction, comb.lift), comb.direction == "down"
    points, normals = grow_guides(head, comb, guides, heading, length, steps, seed, aside=hangs)
    if comb.direction == "tie":  # closes the gap of the last steps to the tie
        points = points + combing.ramp(np.linspace(0, 1, steps + 1), 0.3, 1.0)[None, :, None] * (goal - points[:, -1:])
    roots = combing.plant_roots(head, comb.count * comb.strands, 1, share)
    pieces = int(np.clip(np.ceil(length.max() / (0.018 if fine else 0.03)), 4, 14))
    if comb.curl:
        pieces = int(np.clip(np.ceil(5 * length.max() / comb.pitch), pieces, 16 if fine else 12))
    strands = spread_strands(comb, guides, (points, normals), roots, length, pieces, seed)
    return ribbons(comb.width, strands, roots.random, ROLL)


def tied_hair(head: Head, kind: str) -> Strip:
    """Builds hair that is tied at the back of the head, as a bun or a ponytail."""
    start, direction = combing.tie_point(head.motion)
    count, width = (900, 0.0028) if head.fine else (260, 0.006)  # strands, metres
    random = random_numbers(count, 4, head.seed + 50)
    if kind == "bun":
        return ribbons(width, _bun_arcs(start + 0.022 * direction, direction, random), random, roll=0.3)
    side = np.array([1.0, 0, 0])
    up = np.cross(direction, side)
    angle = 2 * np.pi * random[:, 2]
    spoke = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up  # away from the middle of the tail
    comb = Comb(count=count, length=0.24, body=0.022, weight=0.4)
    tied = start + 0.010 * np.sqrt(random[:, :1]) * spoke - 0.006 * direction
    roots = Roots(tied, normals=np.tile(direction, (count, 1)), sides=spoke, rim=np.ones(count), random=random)
    length = comb.length * (0.7 + 0.45 * random[:, 0])
    heading = 0.6 * direction + 0.3 * np.sqrt(random[:, :1]) * spoke - np.array([0.0, 0.35, 0.0])
    steps = 14 if head.fine else 9
    points, normals = grow_guides(head, comb, roots, heading, length, steps, head.seed, aside=False)
    return ribbons(width, (points, np.broadcast_to(spoke[:, None], normals.shape)), random, roll=0.6)


def _bun_arcs(centre: np.ndarray, axis: np.ndarray, random: np.ndarray) -> Lines:
    """Lays arcs around a ball, as hair is wound into a bun; `axis` points away from the head.

    `random` (n,4) in [0,1] has the place along the axis, a number unused here, the place around it, and the distance
    from the centre. Returns the arcs, of 12 points, with outward normals.
    """
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, axis)
    azimuth = np.linspace(-1.0, 1.0, 12)[None] + 2 * np.pi * random[:, 2:3]  # radians about the axis
    height = np.clip((2 * random[:, :1] - 1) + 0.2 * np.sin(azimuth * 0.8), -0.999, 0.999)  # along it, over the radius
    ring = np.sqrt(1 - height**2)
    outward = (ring * np.cos(azimuth))[..., None] * side + (ring * np.sin(azimuth))[..., None] * up
    outward = outward + 0.8 * height[..., None] * axis  # the ball is flattened
    radius = 0.030 + 0.005 * random[:, 3, None, None]  # metres
    return centre + outward * radius, outward
