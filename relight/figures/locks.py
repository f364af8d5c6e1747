"""Locks of hair: tapered strips that grow out of the scalp, are combed, fall, and come to lie on head and shoulders."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.colliders import Collider
from relight.figures.combing import Comb, Roots, combed, head_centre, plant, ramp, tie_point
from relight.figures.fabrics import lattice, noise
from relight.figures.layers import sided
from relight.figures.poses import Motion

NEAR = 0.08  # metres within which a lock feels what is below it


def grown(
    comb: Comb,
    roots: Roots,
    way: np.ndarray,
    length: np.ndarray,
    below: Collider,
    steps: int,
    seed: int,
    going: np.ndarray | None = None,
    shy: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Centre lines (n, steps+1, 3) of locks that set out along `way` (n,3, posed), and the normal of what lies below
    them. Each step follows the last one, falls, and slides along what is in its way. going (n,3): where they set out
    to, if not along the skin; shy: moves the next points (n,3) away from where no hair shall hang."""
    n = len(roots.points)
    layer = 0.003 + comb.body * (0.25 + 0.75 * roots.pick[:, 3]) * (0.35 + 0.65 * roots.rim)
    flat = way - (way * roots.normals).sum(1, keepdims=True) * roots.normals
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    if going is None:
        going = flat + comb.lift * (0.5 + roots.pick[:, :1]) * roots.normals
    going /= np.linalg.norm(going, axis=1, keepdims=True)
    rise = comb.above * np.sqrt(roots.rim * (2 - roots.rim))
    at = roots.points + (rise - 0.002)[:, None] * roots.normals
    normal = roots.normals
    points, normals = [at], [normal]
    step = (length / steps)[:, None]
    for k in range(1, steps + 1):
        wander = np.stack([noise(roots.sides[:, c] * 9 + c, np.full(n, 0.7 * k), seed + c) for c in range(3)], -1) - 0.5
        going = going + [0, -comb.weight * min(1.0, 2.5 * k / steps), 0] + 0.2 * wander
        going /= np.linalg.norm(going, axis=1, keepdims=True)
        ahead = at + step * going
        face, distance, facing = sided(ahead, below, NEAR)
        close = face >= 0
        normal = np.where(close[:, None], facing, normal)
        room = layer * min(1.0, k / 2.5)
        out = np.where(close, room - np.where(close, distance, 0), 0)
        out = np.where(out > 0, out, comb.cling * out)
        ahead = ahead + np.clip(out, -0.03, 0.03)[:, None] * normal
        if shy is not None:
            ahead = shy(at, ahead)
        going = (ahead - at) / np.maximum(np.linalg.norm(ahead - at, axis=1, keepdims=True), 1e-9)
        at = at + step * going
        points.append(at)
        normals.append(normal)
    normals = np.stack(normals, 1)
    for _ in range(2):
        normals[:, 1:-1] = (normals[:, :-2] + 2 * normals[:, 1:-1] + normals[:, 2:]) / 4
    return np.stack(points, 1), normals


def off_the_face(body: Body, motion: Motion) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Moves what hangs before the face to its sides, and lets what lies on the shoulders fall rather than spread."""
    centre, head = head_centre(body), motion.transforms[-1, motion.bones["head"]]
    cheek = body.skin[np.abs(body.skin[:, 1] - centre[1] + 0.05) < 0.02]
    width = 0.90 * cheek[cheek[:, 2] > centre[2] + 0.03, 0].max()

    def shy(at: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        rest, last = ((points - head[:, 3]) @ head[:, :3] - centre for points in (ahead, at))
        side = np.where(rest[:, 0] > 0, 1.0, -1.0)
        before = ramp(rest[:, 2], 0.02, 0.06) * ramp(-rest[:, 1], -0.03, 0.02)
        aside = 0.6 * before * np.maximum(width - np.abs(rest[:, 0]), 0)
        spread = 0.75 * ramp(-rest[:, 1], 0.09, 0.14) * np.maximum((rest[:, 0] - last[:, 0]) * side, 0)
        return ahead + ((aside - spread) * side)[:, None] * head[:, 0]

    return shy


def curled(comb: Comb, points: np.ndarray, normals: np.ndarray, length: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """The centre lines wound about themselves: waves where the pitch is long, curls where it is short."""
    s = np.linspace(0, 1, points.shape[1])[None]
    along = np.gradient(points, axis=1)
    across = np.cross(along, normals)
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-9)
    angle = 2 * np.pi * (s * length[:, None] / comb.pitch + phase[:, None])
    radius = comb.curl * np.minimum(1, 3 * s)
    off = radius * (1 + np.cos(angle)) * (0.4 if comb.pitch > 0.06 else 1.0)  # waves lie flat, curls are round
    return points + (radius * np.sin(angle))[..., None] * across + off[..., None] * normals


def ribbons(
    comb: Comb, points: np.ndarray, normals: np.ndarray, pick: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arched strips along centre lines (n,m,3): vertices, faces, uv (v runs down the lock). Open below: a closed tube
    has round normals and reads as a rope."""
    n, m, _ = points.shape
    s = np.linspace(0, 1, m)
    along = np.gradient(points, axis=1)
    across = np.cross(along, normals)
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-9)
    up = np.cross(across, along)
    up /= np.maximum(np.linalg.norm(up, axis=2, keepdims=True), 1e-9)
    outline = np.interp(s, [0, 0.2, 0.6, 0.92, 1.0], [0.7, 1.0, 1.0, comb.taper, 0.08])  # a cut end would read as paper
    half = (0.5 * comb.width * (0.7 + 0.6 * pick[:, :1]) * outline)[..., None]
    ring = np.stack([points - across * half, points + up * 0.2 * half, points + across * half], 2)
    base = (np.arange(n)[:, None] * 3 * m + 3 * np.arange(m - 1)).reshape(-1)
    faces = []
    for a, b in ((0, 1), (1, 2)):
        faces += [np.stack([base + a, base + b, base + 3 + a], 1), np.stack([base + b, base + 3 + b, base + 3 + a], 1)]
    u = np.clip(pick[:, 1, None, None] + 0.03 * np.array([-1.0, 0, 1]), 0, 1)
    uv = np.stack(np.broadcast_arrays(u, 1 - s[None, :, None]), -1).reshape(-1, 2)
    return ring.reshape(-1, 3), np.concatenate(faces), uv


def grow(
    body: Body, motion: Motion, comb: Comb, below: tuple[np.ndarray, np.ndarray], seed: int, fine: bool, hat: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All locks of a head: posed vertices, faces, uv. below: posed surface of skin and clothes; fine: all of the
    locks, else half of them, wider; hat: only what a hat leaves free."""
    if not fine:
        comb = coarser(comb)
    posed = motion.skin(makehuman.rig().weights[makehuman.BODY], body.skin)
    roots = plant(body, posed, comb.count, seed, hat)
    way, length = combed(comb, roots)
    turn = motion.transforms[-1, motion.bones["head"], :, :3]
    surface = Collider(below[0], below[0], below[1])
    steps = int(np.clip(np.ceil(length.max() / (0.014 if fine else 0.022)), 5, 18))
    if comb.curl:
        steps = int(np.clip(np.ceil(length.max() / (comb.pitch / 5)), steps, 22))
    way = way @ turn.T
    if comb.way == "tie":
        goal, _ = tie_point(body, motion)
        way = goal - roots.points
        length = 1.12 * np.linalg.norm(way, axis=1)
    shy = off_the_face(body, motion) if comb.way == "down" else None
    points, normals = grown(comb, roots, way, length, surface, steps, seed, shy=shy)
    if comb.way == "tie":  # what the last steps miss of the tie
        points = points + ramp(np.linspace(0, 1, steps + 1), 0.3, 1.0)[None, :, None] * (goal - points[:, -1:])
    if comb.curl:
        phase = (
            roots.pick[:, 2] if comb.pitch < 0.06 else 1.5 * noise(4 * roots.sides[:, 0], 4 * roots.sides[:, 2], seed)
        )
        points = curled(comb, points, normals, length, phase)
    return ribbons(comb, points, normals, roots.pick)


def tail(
    body: Body, motion: Motion, kind: str, below: tuple[np.ndarray, np.ndarray], seed: int, fine: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The bun or the ponytail of tied hair: posed vertices, faces, uv."""
    start, way = tie_point(body, motion)
    count = 130 if fine else 70
    number = np.arange(count)
    pick = np.stack([lattice(number, np.full(count, k), seed + 50) for k in range(4)], -1)
    side = np.array([1.0, 0, 0])
    up = np.cross(way, side)
    angle = 2 * np.pi * pick[:, 2]
    spoke = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
    if kind == "bun":
        return ribbons(
            Comb(count, 0.1, width=0.012 if fine else 0.016, taper=0.8), *wound(start + 0.022 * way, way, pick), pick
        )
    comb = Comb(count, 0.24, width=0.012 if fine else 0.016, body=0.020, weight=0.4, taper=0.3, cling=0.0, lift=0.0)
    at = start + 0.010 * np.sqrt(pick[:, :1]) * spoke - 0.006 * way
    roots = Roots(at, np.tile(way, (count, 1)), spoke, np.ones(count), pick)
    length = comb.length * (0.8 + 0.35 * pick[:, 0])
    surface = Collider(below[0], below[0], below[1])
    points, normals = grown(
        comb,
        roots,
        spoke,
        length,
        surface,
        14 if fine else 9,
        seed,
        going=0.6 * way + 0.3 * spoke - np.array([0.0, 0.35, 0.0]),
    )
    return ribbons(comb, points, np.broadcast_to(spoke[:, None], normals.shape), pick)


def wound(centre: np.ndarray, axis: np.ndarray, pick: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Arcs around a ball, as hair is wound into a bun: centre lines and outward normals."""
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, axis)
    t = np.linspace(-1.0, 1.0, 12)[None] + 2 * np.pi * pick[:, 2:3]
    height = (2 * pick[:, :1] - 1) * 0.9 + 0.25 * np.sin(t * 0.8)
    height = np.clip(height, -0.95, 0.95)
    flat = np.sqrt(1 - height**2)
    out = (flat * np.cos(t))[..., None] * side + (flat * np.sin(t))[..., None] * up + 0.8 * height[..., None] * axis
    return centre + out * (0.030 + 0.005 * pick[:, 3, None, None]), out


def coarser(comb: Comb) -> Comb:
    return replace(comb, count=comb.count // 2, width=1.35 * comb.width)
