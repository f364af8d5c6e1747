"""Folds finer than the drape resolves, where its cloth is compressed: crests across the compression, as deep as the
length that is left over asks for.

The drape's strain against its pattern says how much cloth is too long, and in which direction (a tension field, as in
Rohmer et al., "Animation wrinkling: augmenting coarse cloth simulations with realistic-looking wrinkles", 2010). Each
fold is a crest of its own, traced through that field, that rises and ends somewhere: cloth has no endless ripples.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from relight.figures.drape import Crimp, Level
from relight.figures.surfaces import neighbours, normals

NEAR = 26  # vertices that a point of a crest may lift
DENSE = 4  # times as many where vertices lie at least twice as dense as usual, as in what lined a cleft
STEEP = 0.14  # most height of a crest per width
TAPER = 1.4  # height of a crest's middle over that of an endless one which uses up as much length
SCALES = (1.0, 1.9, 2.6)  # widths of the folds of each level, from fine to coarse, over the finest
SHARES = (0.6, 0.4, 0.7)  # of the length to lose in each; the drape has the widest, but where cloth hangs free
PROFILE = 4.4  # a fold's width over the length in its profile, (1 - t^2) exp(-t^2 / 2)
VERTICES = 2.7  # of a level to a fold's width, at least
CROWD = 2.2  # most crests on the area of one
PRESSED = 0.20  # most length to lose, per length
HIGH = 0.28  # most height of all crests together, in widths of the finest folds, at the finest scale


def stretch(pattern: np.ndarray, x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The right Cauchy-Green tensors (n,3,3), in the tangent planes of the pattern (n,3), of the map to x (n,3): means
    over the faces of each vertex, weighted by area."""
    a, b, c = faces.T
    flat = np.stack([pattern[b] - pattern[a], pattern[c] - pattern[a]], axis=1)
    bent = np.stack([x[b] - x[a], x[c] - x[a]], axis=1)
    metric = np.einsum("fix,fjx->fij", flat, flat)
    area = np.sqrt(np.maximum(metric[:, 0, 0] * metric[:, 1, 1] - metric[:, 0, 1] ** 2, 1e-16))
    inverse = np.stack([metric[:, 1, 1], -metric[:, 0, 1], -metric[:, 0, 1], metric[:, 0, 0]], 1).reshape(-1, 2, 2)
    dual = np.einsum("fij,fjx->fix", inverse / area[:, None, None] ** 2, flat)
    tensor = np.einsum("fix,fij,fjy->fxy", dual, np.einsum("fix,fjx->fij", bent, bent), dual)
    weight = np.repeat(area, 3)
    total = np.bincount(faces.ravel(), weight, len(pattern))
    upper = [(i, j) for i in range(3) for j in range(i, 3)]
    out = np.empty((len(pattern), 3, 3))
    for i, j in upper:
        mean = np.bincount(faces.ravel(), weight * np.repeat(tensor[:, i, j], 3), len(pattern))
        out[:, i, j] = out[:, j, i] = mean / np.maximum(total, 1e-16)
    return out


def areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area (n,) around each vertex of a surface (n,3): a third of its faces', square metres."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.bincount(faces.ravel(), np.repeat(third, 3), len(points))


def principal(tensor: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least stretch (n,), and its unit direction (n,3), of symmetric tensors (n,3,3), in the planes with unit
    normals (n,3)."""
    helper = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0, 0]], [[0.0, 1, 0]])
    one = np.cross(normal, helper)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    two = np.cross(normal, one)
    p, q = (np.einsum("nx,nxy,ny->n", v, tensor, v) for v in (one, two))
    r = np.einsum("nx,nxy,ny->n", one, tensor, two)
    mean, spread = (p + q) / 2, np.hypot((p - q) / 2, r)
    angle = 0.5 * np.arctan2(2 * r, p - q) + np.pi / 2
    direction = np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * two
    return np.sqrt(np.maximum(mean - spread, 0)), direction


def field(points: np.ndarray, size: float, seed: int) -> np.ndarray:
    """Smooth noise (n,), mean 0 and standard deviation about 1, with features of `size` metres: plane waves."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(12, 3)) / size * 1.6
    return np.sqrt(2 / 12) * np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, 12)).sum(1)


def crests(
    tree: cKDTree, normal: np.ndarray, along: np.ndarray, start: np.ndarray, length: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lines through the direction field `along` (n,3) of a surface with the vertices of `tree` and normals (n,3), from
    its vertices `start` (m,), both ways.

    Returns, for each point of a line, its place (k,3), the nearest vertex (k,), its line (k,) and its distance (k,)
    from the middle over half the line's length, in [-1,1].
    """
    points = tree.data
    places, nearest, lines, at = [], [], [], []
    for sign in (1.0, -1.0):
        place, vertex = points[start].copy(), start.copy()
        heading = sign * along[start]
        for k in range(int(np.ceil(length.max() / 2 / step))):
            on = np.flatnonzero(k * step < length / 2)
            if k or sign > 0:
                places.append(place[on])
                nearest.append(vertex[on])
                lines.append(on)
                at.append(sign * 2 * k * step / length[on])
            ahead = along[vertex]
            ahead = ahead * np.where(np.einsum("mx,mx->m", ahead, heading) < 0, -1.0, 1.0)[:, None]
            heading = 0.5 * heading + 0.5 * ahead
            heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-9)
            place = place + step * heading
            vertex = tree.query(place)[1]
            off = np.einsum("mx,mx->m", place - points[vertex], normal[vertex])
            place = place - off[:, None] * normal[vertex]
    return np.concatenate(places), np.concatenate(nearest), np.concatenate(lines), np.concatenate(at)


def ridges(
    pattern: np.ndarray,
    x: np.ndarray,
    faces: np.ndarray,
    around: sparse.csr_matrix,
    crimp: Crimp,
    share: float,
    free: np.ndarray,
    hang: np.ndarray,
    most: float,
    seed: int,
) -> np.ndarray:
    """Heights (n,), metres, at `most`, of the folds of one width; see `folds`. share: of the length to lose that they
    take."""
    mean = float(np.linalg.norm(pattern[faces[:, 0]] - pattern[faces[:, 1]], axis=1).mean())
    times = int(np.ceil(6 * (0.0062 / mean) ** 2))  # over the same centimetre at every level
    flat, hung = (averaged(points, around, times) for points in (pattern, x))
    normal = normals(pattern, faces)
    rows = stretch(flat, hung, faces).reshape(-1, 9)
    for _ in range(3):
        rows = 0.4 * rows + 0.6 * (around @ rows)
    tensor = rows.reshape(-1, 3, 3)
    for k in range(3):  # where nothing presses, what was folded and sat upon decides
        other = (k + 1) % 3
        skew = 0.015 * field(pattern, 0.08, seed + 3 + k)
        tensor[:, k, k] += 0.02 * field(pattern, 0.08, seed + k)
        tensor[:, k, other] += skew
        tensor[:, other, k] += skew
    level = np.stack([normal[:, 2], 0 * hang, -normal[:, 0]], axis=1)  # what hangs free falls into upright folds
    tensor -= (0.10 * hang)[:, None, None] * level[:, :, None] * level[:, None, :]
    least, across = principal(tensor, normal)
    old = np.clip(1 + 0.6 * field(pattern, 0.10, seed + 7), 0.1, 2.2)
    room = np.sqrt(share * free * np.clip(crimp.slack * old + 1 - least, 0, PRESSED))
    along = np.cross(normal, across)
    rng = np.random.default_rng([seed, 5])
    longer = 1 + 1.2 * hang
    crowd = CROWD * np.clip(5 * crimp.density * room, 0, 1)  # on the area of one crest
    area = areas(pattern, faces)
    usual = float(np.median(area))  # sparser vertices carry no more crests
    chance = crowd * np.minimum(area, usual) / (crimp.width * crimp.length * longer)
    start = np.flatnonzero(rng.random(len(x)) < chance)
    if not len(start):
        return np.zeros(len(x))
    length = crimp.length * longer[start] * np.exp(rng.normal(0, 0.45, len(start)))
    wide = crimp.width * np.exp(rng.normal(0, 0.22, len(start)))
    tall = np.where(rng.random(len(start)) < 0.75, 1.0, -0.7) * np.exp(rng.normal(0, 0.25, len(start)))
    step = 1.5 * mean
    tree = cKDTree(pattern)
    place, vertex, line, at = crests(tree, normal, along, start, length, step)
    rise = tall[line] * wide[line] * np.minimum(TAPER * room[vertex] / np.pi, STEEP)  # A k = 2 sqrt(excess)
    rise *= np.cos(0.5 * np.pi * np.clip(at, -1, 1)) ** 0.8
    height, dense = np.zeros(len(x)), area[vertex] < 0.5 * usual
    for on, count in ((np.flatnonzero(~dense), NEAR), (np.flatnonzero(dense), DENSE * NEAR)):
        _, near = tree.query(place[on], min(count, len(x)))
        offset, middle = pattern[near] - place[on, None], vertex[on]
        s = np.einsum("kjx,kx->kj", offset, along[middle]) / step
        t = np.einsum("kjx,kx->kj", offset, across[middle]) * (PROFILE / wide[line[on]])[:, None]
        facing = np.clip(np.einsum("kjx,kx->kj", normal[near], normal[middle]) / 0.6, 0, 1)
        lift = rise[on, None] * facing * (1 - t**2) * np.exp(-0.5 * t**2 - 0.5 * s**2) / np.sqrt(2 * np.pi)
        height += np.bincount(near.ravel(), lift.ravel(), len(x))
    return free * most * np.tanh(height / most)


def averaged(values: np.ndarray, around: sparse.csr_matrix, times: int) -> np.ndarray:
    """Vertex values (n,...) averaged `times` with those of their neighbours."""
    for _ in range(times):
        values = 0.5 * values + 0.5 * (around @ values)
    return values


def smoothness(points: np.ndarray, faces: np.ndarray, around: sparse.csr_matrix) -> np.ndarray:
    """1 where a surface (n,3) is smooth, falling to 0 (n,) where it turns sharply: in a pleat, folds find no room."""
    normal = normals(points, faces)
    mean = averaged(normal, around, 6)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    return np.clip((np.einsum("nx,nx->n", normal, mean) - 0.55) / 0.3, 0, 1)


def folds(levels: list[Level], refine: list, x: np.ndarray, crimp: Crimp, hang: np.ndarray, seed: int) -> np.ndarray:
    """Heights (n,), metres, of the folds of a cloth that hangs at x (n,3), finest level.

    Wider folds are made on coarser levels. Where pins hold the cloth there are none; hang (n,) in [0,1]: how freely it
    hangs down.
    """
    finest, height = levels[-1], np.zeros(len(x))
    around = neighbours(finest.faces, len(x))
    smooth = np.minimum(*(smoothness(points, finest.faces, around) for points in (finest.rest_shape, x)))
    for back, (scale, share) in enumerate(zip(SCALES[: len(levels)], SHARES), 1):
        level = levels[-back]
        if scale == SCALES[-1] and not hang.any():
            continue
        n = len(level.rest_shape)  # subdivision keeps the vertices of the coarser levels, and begins with them
        mean = float(
            np.linalg.norm(level.rest_shape[level.faces[:, 0]] - level.rest_shape[level.faces[:, 1]], axis=1).mean()
        )
        wide = max(crimp.width * scale, VERTICES * mean)
        this = replace(crimp, width=wide, length=crimp.length * max(1.0, wide / crimp.width) ** 0.7)
        free = smooth[:n] * (1 - np.clip(1.5 * level.pin_weight, 0, 1)) * (hang[:n] if scale == SCALES[-1] else 1)
        most = HIGH * crimp.width * np.sqrt(scale)
        near = around if back == 1 else neighbours(level.faces, n)
        more = ridges(level.rest_shape, x[:n], level.faces, near, this, share, free, hang[:n], most, seed + 100 * back)
        for up in refine[len(refine) - back + 1 :]:
            more = up @ more
        height += more
    return smooth * height


def of_one_garment(crimp: Crimp, seed: int) -> Crimp:
    """The folds of one piece: pressed or slept in, soft or stiff, as it comes."""
    one, two, three = np.random.default_rng([seed, 6]).normal(size=3)
    return replace(
        crimp,
        width=crimp.width * np.exp(0.15 * one),
        slack=crimp.slack * np.exp(0.22 * two),
        density=crimp.density * np.exp(0.25 * three),
    )


def folded(levels: list[Level], refine: list, x: np.ndarray, crimp: Crimp, hang: np.ndarray, seed: int) -> np.ndarray:
    """The cloth at x (n,3) with its `folds`, raised along its smooth normals."""
    faces = levels[-1].faces
    out = averaged(normals(x, faces), neighbours(faces, len(x)), 3)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    return x + folds(levels, refine, x, crimp, hang, seed)[:, None] * out
