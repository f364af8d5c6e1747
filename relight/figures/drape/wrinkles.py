"""Wrinkles finer than the simulation: crests across the compression of the cloth, as deep as its excess length asks.

The deformation of the simulated cloth against its pattern gives its excess length and direction (a tension field, as in
Rohmer et al., "Animation wrinkling: augmenting coarse cloth simulations with realistic-looking wrinkles", 2010). Each
wrinkle is one crest, traced through that field, that rises and ends: cloth has no endless ripples.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from relight.figures.cut.level import Level
from relight.figures.draw.garments import Crimp
from relight.figures.surfaces import averaged, face_normals, neighbours, normals, unit_rows

NEAREST = 26  # vertices that a point of a crest may lift
DENSE_FACTOR = 4  # times as many where vertices are at least twice as dense as usual, as in the cleft of the buttocks
MAX_SLOPE = 0.14  # height of a crest over its width
TAPER = 1.4  # height of a crest's middle over that of an endless one that takes up the same length
SCALES = (1.0, 1.9, 2.6)  # width of the folds of each level, from fine to coarse, over that of the finest
SHARES = (0.6, 0.4, 0.7)  # of the excess length in each; the simulation has the widest, except where cloth hangs free
PROFILE = 4.4  # a fold's width over the length in its profile, (1 - t^2) exp(-t^2 / 2)
MIN_EDGES = 2.7  # edges of a level per fold width
MAX_CROWD = 2.2  # crests on the area of one
MAX_EXCESS = 0.20  # excess length, relative
MAX_HEIGHT = 0.28  # of all crests together, in widths of the finest folds, at the finest scale
SHARP, SMOOTH = 0.55, 0.85  # cosine of a normal and the mean around it where cloth gets no folds, and all of them
SMOOTHINGS = 6  # averagings of normals
SMOOTHED_EDGE = 0.0062  # edge length for which cloth is averaged 6 times before its deformation is measured, metres


def stretch(pattern: np.ndarray, x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Computes the right Cauchy-Green tensors of a deformation; their eigenvalues are squares of stretches.

    They lie in the tangent planes of the pattern, and are averages over the faces of each vertex, weighted by area.

    Args:
        pattern: (n,3) vertices before it, metres.
        x: (n,3) the same after it.
        faces: (F,3).

    Returns:
        (n,3,3).
    """
    a, b, c = faces.T
    flat_sides = np.stack([pattern[b] - pattern[a], pattern[c] - pattern[a]], axis=1)  # (F,2,3)
    bent_sides = np.stack([x[b] - x[a], x[c] - x[a]], axis=1)
    metric = np.einsum("fix,fjx->fij", flat_sides, flat_sides)
    area = np.sqrt(np.maximum(metric[:, 0, 0] * metric[:, 1, 1] - metric[:, 0, 1] ** 2, 1e-16))  # times two
    adjugate = np.stack([metric[:, 1, 1], -metric[:, 0, 1], -metric[:, 0, 1], metric[:, 0, 0]], 1).reshape(-1, 2, 2)
    dual = np.einsum("fij,fjx->fix", adjugate / area[:, None, None] ** 2, flat_sides)  # dual_i . flat_j = delta_ij
    tensor = np.einsum("fix,fij,fjy->fxy", dual, np.einsum("fix,fjx->fij", bent_sides, bent_sides), dual)
    weight = np.repeat(area, 3)  # of a face's corners
    total = np.bincount(faces.ravel(), weight, len(pattern))
    means = np.empty((len(pattern), 3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):  # the others are equal to these
        weighted_sum = np.bincount(faces.ravel(), weight * np.repeat(tensor[:, i, j], 3), len(pattern))
        means[:, i, j] = means[:, j, i] = weighted_sum / np.maximum(total, 1e-16)
    return means


def areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns the area (n,) of each vertex of a surface (n,3): a third of that of its faces, square metres."""
    third = np.linalg.norm(face_normals(points, faces), axis=1) / 6
    return np.bincount(faces.ravel(), np.repeat(third, 3), len(points))


def principal(tensor: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Finds the least stretch, the root of the smaller eigenvalue, of Cauchy-Green tensors in planes.

    In two axes of its plane, a tensor is a matrix [[p, r], [r, q]].

    Args:
        tensor: (n,3,3), symmetric.
        normal: (n,3) unit normals of the planes.

    Returns:
        The least stretch (n,), less than 1 in compressed cloth, and its unit direction (n,3).
    """
    helper = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0, 0]], [[0.0, 1, 0]])  # not parallel to the normal
    across = unit_rows(np.cross(normal, helper))
    along = np.cross(normal, across)
    p, q = (np.einsum("nx,nxy,ny->n", axis, tensor, axis) for axis in (across, along))
    r = np.einsum("nx,nxy,ny->n", across, tensor, along)
    mean, spread = (p + q) / 2, np.hypot((p - q) / 2, r)
    angle = 0.5 * np.arctan2(2 * r, p - q) + np.pi / 2
    direction = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * along
    return np.sqrt(np.maximum(mean - spread, 0)), direction


def _smooth_noise(points: np.ndarray, size: float, seed: int) -> np.ndarray:
    """Returns smooth noise (n,) at points (n,3), metres: a sum of plane waves in random directions.

    It has mean 0, a standard deviation of about 1, and features of `size` metres.
    """
    rng, count = np.random.default_rng(seed), 12  # of the waves
    waves = rng.normal(size=(count, 3)) / size * 1.6
    return np.sqrt(2 / count) * np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, count)).sum(1)


def _trace_crests(
    tree: cKDTree, normal: np.ndarray, along: np.ndarray, start: np.ndarray, length: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Traces lines through a direction field on a surface, both ways from some of its vertices.

    `tree` holds the vertices (n,3), with unit normals and field `along` (n,3); lines begin at the vertices `start` (m,)
    and have a `length` (m,), with a point every `step`, metres. Returns for each of k points its place (k,3), the
    nearest vertex (k,), its line (k,) and its signed distance (k,) from the middle over half the length, in [-1,1].
    """
    points = tree.data
    samples = []
    for sign in (1.0, -1.0):
        place, vertex = points[start].copy(), start.copy()
        heading = sign * along[start]
        for k in range(int(np.ceil(length.max() / 2 / step))):
            unfinished = np.flatnonzero(k * step < length / 2)
            if k or sign > 0:
                distance = sign * 2 * k * step / length[unfinished]
                samples.append((place[unfinished], vertex[unfinished], unfinished, distance))
            ahead = along[vertex]
            ahead = ahead * np.where(np.einsum("mx,mx->m", ahead, heading) < 0, -1.0, 1.0)[:, None]
            heading = unit_rows(0.5 * heading + 0.5 * ahead)
            place = place + step * heading
            vertex = tree.query(place)[1]
            off = np.einsum("mx,mx->m", place - points[vertex], normal[vertex])
            place = place - off[:, None] * normal[vertex]
    places, nearest, lines, distances = (np.concatenate(column) for column in zip(*samples))
    return places, nearest, lines, distances


@dataclass(frozen=True)
class Region:
    """The cloth of one level and where it may wrinkle.

    Attributes:
        rest_shape: (n,3) vertices of the pattern, metres.
        x: (n,3) the same as draped.
        faces: (F,3).
        average: (n,n) matrix of averages over neighbours.
        free: (n,) in [0,1], how freely the cloth can wrinkle; 0 where it is pinned.
        hang: (n,) in [0,1], how freely it hangs down.
        edge: mean length of its edges, metres.
    """

    rest_shape: np.ndarray
    x: np.ndarray
    faces: np.ndarray
    average: sparse.csr_matrix
    free: np.ndarray
    hang: np.ndarray
    edge: float


def _compression(region: Region, normal: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the least stretch (n,), below 1 where cloth is compressed, and its unit direction (n,3) on the pattern.

    `normal` (n,3) are unit normals of the pattern, and `seed` that of old creases.
    """
    times = int(np.ceil(6 * (SMOOTHED_EDGE / region.edge) ** 2))  # the same centimetre at all levels
    rest, draped = (averaged(points, region.average, times) for points in (region.rest_shape, region.x))
    rows = stretch(rest, draped, region.faces).reshape(-1, 9)
    for _ in range(3):
        rows = 0.4 * rows + 0.6 * (region.average @ rows)
    tensor = rows.reshape(-1, 3, 3)
    for k in range(3):  # where nothing compresses the cloth, old creases give the direction: a symmetric random tensor
        other = (k + 1) % 3
        skew = 0.015 * _smooth_noise(region.rest_shape, 0.08, seed + 3 + k)
        tensor[:, k, k] += 0.02 * _smooth_noise(region.rest_shape, 0.08, seed + k)
        tensor[:, k, other] += skew
        tensor[:, other, k] += skew
    # Cloth that hangs free falls into upright folds, as if it were compressed in the level direction of its plane.
    level = np.stack([normal[:, 2], 0 * region.hang, -normal[:, 0]], axis=1)
    tensor -= (0.10 * region.hang)[:, None, None] * level[:, :, None] * level[:, None, :]
    return principal(tensor, normal)


def _ridges(region: Region, crimp: Crimp, share: float, max_height: float, seed: int) -> np.ndarray:
    """Returns the heights (n,), metres, of the folds of one width, which take up a share of the excess length."""
    rest, hang, count = region.rest_shape, region.hang, len(region.x)
    normal = normals(rest, region.faces)
    least_stretch, across = _compression(region, normal, seed)
    creased = np.clip(1 + 0.6 * _smooth_noise(rest, 0.10, seed + 7), 0.1, 2.2)  # cloth is creased more in some places
    excess = np.clip(crimp.slack * creased + 1 - least_stretch, 0, MAX_EXCESS)  # relative length to be taken up
    room = np.sqrt(share * region.free * excess)  # proportional to the height of folds that take it up
    along = np.cross(normal, across)
    rng = np.random.default_rng([seed, 5])
    length_factor = 1 + 1.2 * hang  # hanging cloth has longer folds
    crowd = MAX_CROWD * np.clip(5 * crimp.density * room, 0, 1)
    area = areas(rest, region.faces)
    usual = float(np.median(area))  # sparser vertices start no more crests
    probability = crowd * np.minimum(area, usual) / (crimp.width * crimp.length * length_factor)
    start = np.flatnonzero(rng.random(count) < probability)
    if not len(start):
        return np.zeros(count)
    length = crimp.length * length_factor[start] * np.exp(rng.normal(0, 0.45, len(start)))
    width = crimp.width * np.exp(rng.normal(0, 0.22, len(start)))
    relief = np.where(rng.random(len(start)) < 0.75, 1.0, -0.7) * np.exp(rng.normal(0, 0.25, len(start)))
    step = 1.5 * region.edge
    tree = cKDTree(rest)
    place, vertex, line, distance = _trace_crests(tree, normal, along, start, length, step)
    # a sinusoid of amplitude A and wavenumber k takes up the relative length (A k / 2)^2
    rise = relief[line] * width[line] * np.minimum(TAPER * room[vertex] / np.pi, MAX_SLOPE)
    rise *= np.cos(0.5 * np.pi * np.clip(distance, -1, 1)) ** 0.8
    height, is_dense = np.zeros(count), area[vertex] < 0.5 * usual
    for chosen, lifted in ((np.flatnonzero(~is_dense), NEAREST), (np.flatnonzero(is_dense), DENSE_FACTOR * NEAREST)):
        _, near = tree.query(place[chosen], min(lifted, count))
        offset, middle = rest[near] - place[chosen, None], vertex[chosen]
        s = np.einsum("kjx,kx->kj", offset, along[middle]) / step  # along the crest, in steps: a Gaussian joins them
        t = np.einsum("kjx,kx->kj", offset, across[middle]) * (PROFILE / width[line[chosen]])[:, None]  # across it
        facing = np.clip(np.einsum("kjx,kx->kj", normal[near], normal[middle]) / 0.6, 0, 1)  # not the other side
        lift = rise[chosen, None] * facing * (1 - t**2) * np.exp(-0.5 * t**2 - 0.5 * s**2) / np.sqrt(2 * np.pi)
        height += np.bincount(near.ravel(), lift.ravel(), count)
    return region.free * max_height * np.tanh(height / max_height)


def _smoothness(points: np.ndarray, faces: np.ndarray, average: sparse.csr_matrix) -> np.ndarray:
    """Returns (n,) weights of folds: 1 where a surface is smooth, 0 at sharp turns, such as pleats.

    `average` (n,n) takes the values of vertices to the means of their neighbours.
    """
    normal = normals(points, faces)
    mean = unit_rows(averaged(normal, average, SMOOTHINGS))
    return np.clip((np.einsum("nx,nx->n", normal, mean) - SHARP) / (SMOOTH - SHARP), 0, 1)


def folds(
    levels: list[Level], refine: list[sparse.csr_matrix], x: np.ndarray, crimp: Crimp, hang: np.ndarray, seed: int
) -> np.ndarray:
    """Computes the heights of a garment's folds: wider ones on coarser levels, none where the cloth is pinned.

    Args:
        levels: levels of the pattern, from coarse to fine.
        refine: matrices from each level's vertices to those of the next.
        x: (n,3) vertices of the finest level as draped, metres.
        crimp: crimp of the finest folds.
        hang: (n,) in [0,1], how freely the cloth hangs down.
        seed: random seed of the folds' places and sizes.

    Returns:
        Heights (n,) along the normals, metres.
    """
    finest, height = levels[-1], np.zeros(len(x))
    average = neighbours(finest.faces, len(x))
    smooth = np.minimum(*(_smoothness(points, finest.faces, average) for points in (finest.rest_shape, x)))
    for back, (scale, share) in enumerate(zip(SCALES[: len(levels)], SHARES), 1):  # 1 is the finest level
        level, widest = levels[-back], scale == SCALES[-1]
        if widest and not hang.any():
            continue
        rest, faces = level.rest_shape, level.faces
        n = len(rest)  # the vertices of a coarser level are the first ones of a finer level
        edge = float(np.linalg.norm(rest[faces[:, 0]] - rest[faces[:, 1]], axis=1).mean())
        width = max(crimp.width * scale, MIN_EDGES * edge)
        scaled = replace(crimp, width=width, length=crimp.length * max(1.0, width / crimp.width) ** 0.7)
        free = smooth[:n] * (1 - np.clip(1.5 * level.pin_weight, 0, 1)) * (hang[:n] if widest else 1)
        level_average = average if back == 1 else neighbours(faces, n)
        region = Region(rest, x[:n], faces, level_average, free, hang[:n], edge)
        max_height = MAX_HEIGHT * crimp.width * np.sqrt(scale)
        level_height = _ridges(region, scaled, share, max_height, seed + 100 * back)
        for matrix in refine[len(refine) - back + 1 :]:
            level_height = matrix @ level_height
        height += level_height
    return smooth * height


def varied(crimp: Crimp, seed: int) -> Crimp:
    """Draws the crimp of one piece of cloth: more or less creased, soft or stiff."""
    spread = np.array([0.15, 0.22, 0.25])  # standard deviation of the logarithm of each factor
    width, slack, density = np.exp(spread * np.random.default_rng([seed, 6]).normal(size=3))
    return replace(crimp, width=crimp.width * width, slack=crimp.slack * slack, density=crimp.density * density)
