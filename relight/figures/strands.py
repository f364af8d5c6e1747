"""Strands of hair: thin ribbons that follow guides, in locks that draw together toward their tips."""

import numpy as np
from scipy.spatial import cKDTree

from relight.figures.combing import Comb, Roots, ramp
from relight.figures.fabrics import lattice, noise

DEEP = 0.002  # metres: what lies deeper under a surface of hair is not seen, and gaps down to it would be black
FLYING = 4.0  # times as far stray a few of them
OUTLINE = ((0.0, 0.15, 0.6, 1.0), (0.75, 1.0, 0.9, 0.15))  # width of a strand over that of the comb, along it


def frames(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors along lines (n,m,3), across them, and up: what is left of the normals (n,m,3) square to both."""

    def unit(vectors: np.ndarray) -> np.ndarray:
        return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)

    along = unit(np.gradient(points, axis=1))
    across = unit(np.cross(along, normals))
    return along, across, np.cross(across, along)


def sampled(values: np.ndarray, line: np.ndarray, at: np.ndarray) -> np.ndarray:
    """What lines of values (g,k,3), with even parameters from 0 to 1, hold at `at` (n,m) of the lines `line` (n,)."""
    x = at * (values.shape[1] - 1)
    i = np.minimum(x.astype(int), values.shape[1] - 2)
    t = (x - i)[..., None]
    return values[line[:, None], i] * (1 - t) + values[line[:, None], i + 1] * t


def spread(
    comb: Comb,
    guides: Roots,
    points: np.ndarray,
    normals: np.ndarray,
    roots: Roots,
    length: np.ndarray,
    steps: int,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Strands (n,steps+1,3) from their roots along the nearest guides, and the normals of the hair there.

    A strand keeps its place beside its guide in the guide's frame, drawn toward it by `comb.clump` at the tip; it lies
    at a depth of its own within DEEP, strays by `comb.fray`, ends a little earlier than others, and is curled.

    Args:
        comb: how the hair is worn.
        guides: roots of the g guides.
        points: (g,k,3) of the guides, metres; their normals (g,k,3).
        normals: (g,k,3) of what the guides lie on.
        roots: of the n strands.
        length: (g,) of the guides, metres.
        steps: pieces of a strand.
        seed: of what strays.
    """
    n = len(roots.points)
    line = cKDTree(guides.points).query(roots.points)[1]
    along, across, up = frames(points, normals)
    off = roots.points - guides.points[line]
    beside = [np.einsum("nd,nd->n", off, axis[line, 0])[:, None, None] for axis in (along, across, up)]
    s = np.linspace(0, 1, steps + 1)[None]
    at = s * (0.78 + 0.22 * roots.pick[:, :1])
    centre, up = sampled(points, line, at), sampled(up, line, at)
    along, across = sampled(along, line, at), sampled(across, line, at)
    near = (1 - comb.clump * ramp(s, 0.05, 1.0))[..., None]
    risen = ramp(s, 0.0, 0.35) * roots.rim[:, None]
    depth = DEEP * (roots.pick[:, 3:4] - 0.5) * risen
    stray = np.where(roots.pick[:, 2:3] > 0.94, FLYING, 1.0) * comb.fray * ramp(s, 0.0, 0.8)
    row = np.arange(n)[:, None] * 7.3
    wave = [np.broadcast_to(3.0 * s, at.shape) + 11 * k for k in range(2)]
    aside, rise = (2 * noise(np.broadcast_to(row, at.shape), w, seed + 31 + k) - 1 for k, w in enumerate(wave))
    rise = np.abs(rise) - 0.3  # what strays outward is seen, what strays inward goes through the head
    if comb.curl:
        common = roots.pick[:, 2:3] if comb.pitch < 0.03 else guides.pick[line, 2:3] + 0.12 * roots.pick[:, 2:3]
        angle = 2 * np.pi * (at * length[line, None] / comb.pitch + common)
        radius = comb.curl * np.minimum(1, 4 * s) * (0.75 + 0.5 * roots.pick[:, 1:2])
        aside = stray * aside + radius * np.sin(angle)
        rise = stray * rise + radius * (1 + np.cos(angle)) * (0.4 if comb.pitch > 0.06 else 1.0)  # waves lie flat
    else:
        aside, rise = stray * aside, stray * rise
    place = centre + near * (beside[0] * along + beside[1] * across + beside[2] * up)
    return place + aside[..., None] * across + (depth + rise)[..., None] * up, up


def ribbons(
    width: float, points: np.ndarray, normals: np.ndarray, pick: np.ndarray, roll: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat ribbons along lines (n,m,3), which face the normals (n,m,3): vertices, faces, uv (v runs down the strand).
    roll: radians by which they are turned about themselves, to either side.

    Flat, as a strand of many hairs lies: tubes would show the camera as much of their sides as of what the hair faces.
    """
    n, m, _ = points.shape
    s = np.linspace(0, 1, m)
    _, across, up = frames(points, normals)
    turn = roll * (2 * pick[:, 3] - 1)[:, None, None]
    half = 0.5 * width * (0.7 + 0.6 * pick[:, :1]) * np.interp(s, *OUTLINE)
    side = half[..., None] * (np.cos(turn) * across + np.sin(turn) * up)
    ring = np.stack([points - side, points + side], 2)
    base = (np.arange(n)[:, None] * 2 * m + 2 * np.arange(m - 1)).reshape(-1)
    faces = np.stack([base, base + 1, base + 2, base + 1, base + 3, base + 2], 1).reshape(-1, 3)
    u = np.clip(pick[:, 1, None, None] + 0.008 * np.array([-1.0, 1]), 0, 1)
    uv = np.stack(np.broadcast_arrays(u, 1 - s[None, :, None]), -1).reshape(-1, 2)
    return ring.reshape(-1, 3), faces, uv


def randoms(count: int, seed: int) -> np.ndarray:
    """Numbers in [0,1), four (count,4) for each strand."""
    number = np.arange(count)
    return np.stack([lattice(number, np.full(count, k), seed) for k in range(4)], -1)
