"""Hair of the face: brows, lashes and beards, as strands that follow the skin."""

from dataclasses import replace

import numpy as np

from relight.figures.assemble.hair.combing import Head, plant_roots, ramp
from relight.figures.assemble.hair.locks import grow_guides
from relight.figures.assemble.hair.strands import Strip, ribbons
from relight.figures.body import makehuman
from relight.figures.catalogue.schema import entries
from relight.figures.draw.hairstyles import Comb
from relight.figures.dye import skin
from relight.figures.texture import random_numbers

STUBBLE = 0.4  # largest amount of beard that is only painted
MIRROR_OFFSET = 125  # from a vertex index of the left lashes to that of the right ones


def brows(head: Head) -> Strip:
    """Grows the hairs of both brows, upward at their inner ends and outward at the outer ones."""
    person = head.motion.body.person
    roots = plant_roots(head, 600 if head.fine else 160, 71, lambda points: skin.brow_share(points, person) - 0.2)
    across = roots.sides[:, 0] * np.sqrt(2)
    outward, side = ramp(np.abs(across), 0.25, 0.85), np.sign(across)  # outward: 0 at the inner end, 1 at the outer
    direction = np.stack([side * (0.5 + 0.6 * outward), 0.6 - 0.95 * outward, np.zeros_like(across)], 1)
    direction += 0.25 * (2 * roots.random[:, 1:] - 1)
    direction = roots.headings(direction @ head.motion.bone("head")[:, :3].T, lift=0.0)
    length = (0.005 + 0.003 * roots.random[:, :1]) * (1 - 0.15 * person.female)  # metres
    s = np.linspace(0, 1, 4)[None, :, None]  # along a hair, from root to tip
    rise = 0.0003 + 0.0014 * s * (1 - 0.75 * s)  # metres off the skin
    points = roots.points[:, None] + s * (length * direction)[:, None] + rise * roots.normals[:, None]
    normals = np.broadcast_to(roots.normals[:, None], points.shape)
    width = 0.0006 if head.fine else 0.0014  # metres
    return ribbons(width, (points, normals), roots.random, roll=0.3)


def lashes(head: Head) -> Strip:
    """Grows lashes from the lids' edges to the tips of MakeHuman's helpers, bent upward (the lower ones downward).

    Each is a quadratic Bezier curve.
    """
    motion = head.motion
    weights, vertices = makehuman.rig().weights, motion.body.vertices
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    fullness = 0.75 + 0.25 * motion.body.person.female  # factor of the length
    lines = entries("faces", "lashes", tuple[tuple[int, ...], tuple[int, ...]])
    lids = ((lines["upper"], 46), (lines["lower"], 26))  # with the number of their lashes
    for number, (line, count) in enumerate(lids * 2):  # of the left eye, then of the right one
        lid, tip = np.array(line) + MIRROR_OFFSET * (number // 2)
        random = random_numbers(count if head.fine else count // 2, 4, head.seed + 80 + number)
        place = np.linspace(0, len(lid) - 1.001, len(random))  # along the lid, in vertices
        i, t = place.astype(int), (place - place.astype(int))[:, None]
        first = vertices[lid[i]] * (1 - t) + vertices[lid[i + 1]] * t
        last = vertices[tip[i]] * (1 - t) + vertices[tip[i + 1]] * t
        last = first + (last - first) * fullness * (0.75 + 0.35 * random[:, :1])
        last[:, 0] += 0.0015 * (2 * random[:, 1] - 1)
        bend = first + (last - first) * [0.6, -0.1, 0.75]  # forward before upward
        s = np.linspace(0, 1, 5)[None, :, None]
        rest = (1 - s) ** 2 * first[:, None] + 2 * s * (1 - s) * bend[:, None] + s**2 * last[:, None]
        points = motion.skin(np.repeat(weights[lid[i]], 5, axis=0), rest.reshape(-1, 3)).reshape(rest.shape)
        parts.append((points, np.broadcast_to(motion.bone("head")[:, 1], points.shape), random))
    points, normals, random = (np.concatenate(column) for column in zip(*parts))
    width = 0.0006 if head.fine else 0.001  # metres
    return ribbons(width, (points, normals), random, roll=0.0)


def beard(head: Head, amount: float) -> Strip | None:
    """Grows a beard of an amount in [0,1], from trimmed to full, on cheeks, lip and chin; None is painted stubble."""
    if amount <= STUBBLE:
        return None
    fullness = (amount - STUBBLE) / (1 - STUBBLE)  # 0 trimmed, 1 full
    roots = plant_roots(head, 6000 if head.fine else 1200, 61, skin.beard_share)
    x, y, z = roots.sides.T
    lip = ramp(y, -0.72, -0.62) * ramp(z, 0.55, 0.7)  # 1 on the upper lip: the moustache is short and parted
    direction = np.stack([0.2 * x + 0.9 * np.sign(x) * lip, -np.ones_like(x), 0.35 * (1 - lip)], 1)
    direction = (direction + 0.2 * (2 * roots.random[:, 1:] - 1)) @ head.motion.bone("head")[:, :3].T
    chin = ramp(-y, 0.55, 0.9) * ramp(z, 0.1, 0.5)  # 1 on the chin, where hair is longest
    length = 0.008 + 0.007 * fullness + 0.022 * fullness * chin  # metres
    length = length * (1 - 0.35 * lip) * (0.6 + 0.5 * roots.random[:, 0])
    comb = Comb(count=len(x), length=0.03, body=0.001 + 0.005 * fullness, lift=0.1, weight=0.15, cling=0.3)
    inner_roots = replace(roots, rim=np.ones(len(x)))  # a beard has no hairline
    steps = 4 if head.fine else 3
    heading = roots.headings(direction, comb.lift)
    hairs = grow_guides(head, comb, inner_roots, heading, length, steps, head.seed + 62, aside=False)
    width = (0.0011 + 0.0008 * fullness) * (1 if head.fine else 1.8)  # metres
    return ribbons(width, hairs, roots.random, roll=0.3)
