"""Strands of hair: thin ribbons that follow guides, in locks that draw together toward their tips."""

import numpy as np
from scipy.spatial import cKDTree

from relight.figures.assemble.hair.combing import Roots, ramp
from relight.figures.draw.hairstyles import Comb
from relight.figures.surfaces import cut_cells, unit_rows
from relight.figures.texture import noise

Lines = tuple[np.ndarray, np.ndarray]  # points (n,m,3) along n lines, metres, and normals (n,m,3) there
Strip = tuple[np.ndarray, np.ndarray, np.ndarray]  # posed vertices, faces, and uv of the vertices
DEPTH = 0.002  # range of depths of strands, metres; gaps in a deeper layer would be black
FLYAWAY = 4.0  # factor of the straying of a few strands
FLYAWAY_FROM = 0.94  # random number above which a strand is one of them
HALF_STRIP = 0.008  # half the width, in u, of the texture on a ribbon
OUTLINE = ((0.0, 0.15, 0.6, 1.0), (0.75, 1.0, 0.9, 0.15))  # position along a strand, width over that of the comb


def _line_frames(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns unit vectors along n lines of m points, across them, and upward, nearest to `normals`, each (n,m,3)."""
    along = unit_rows(np.gradient(points, axis=1))
    across = unit_rows(np.cross(along, normals))
    return along, across, np.cross(across, along)


def _interpolate_lines(values: np.ndarray, line: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolates values (g,k,3) at the k points of g lines: (n,m,3).

    `line` (n,) tells which line to look at, and `at` (n,m) where along it, from 0 to 1.
    """
    x = at * (values.shape[1] - 1)
    i = np.minimum(x.astype(int), values.shape[1] - 2)
    t = (x - i)[..., None]
    return values[line[:, None], i] * (1 - t) + values[line[:, None], i + 1] * t


def spread_strands(
    comb: Comb, guides: Roots, lines: Lines, roots: Roots, length: np.ndarray, steps: int, seed: int
) -> Lines:
    """Lays strands from their roots along the nearest guides.

    A strand keeps its place beside its guide in the guide's frame, drawn toward it by `comb.clump` at the tip; it lies
    at a depth of its own within DEPTH, strays by `comb.fray`, ends a little earlier than others, and is curled.

    Args:
        comb: the style.
        guides: roots of the g guides.
        lines: the g guides, with normals of the surface below them.
        roots: roots of the n strands.
        length: (g,) of the guides, metres.
        steps: segments of a strand.
        seed: random seed of their straying.

    Returns:
        The strands, of steps + 1 points, with normals of the hair.
    """
    points, normals = lines
    guide = cKDTree(guides.points).query(roots.points)[1]  # of each strand
    along, across, up = _line_frames(points, normals)
    off = roots.points - guides.points[guide]
    beside = [np.einsum("nd,nd->n", off, axis[guide, 0])[:, None, None] for axis in (along, across, up)]
    s = np.linspace(0, 1, steps + 1)[None]  # along a strand, from root to tip
    at = s * (0.78 + 0.22 * roots.random[:, :1])  # along its guide
    centre, up = _interpolate_lines(points, guide, at), _interpolate_lines(up, guide, at)
    along, across = _interpolate_lines(along, guide, at), _interpolate_lines(across, guide, at)
    kept_distance = (1 - comb.clump * ramp(s, 0.05, 1.0))[..., None]  # share of the distance from the guide
    layered = ramp(s, 0.0, 0.35) * roots.rim[:, None]  # 0 at the root and at the hairline
    depth = DEPTH * (roots.random[:, 3:4] - 0.5) * layered
    stray = np.where(roots.random[:, 2:3] > FLYAWAY_FROM, FLYAWAY, 1.0) * comb.fray * ramp(s, 0.0, 0.8)  # metres
    # Smooth noise along each strand, other noise for each: rows of the noise are far apart.
    row = np.broadcast_to(np.arange(len(roots.points))[:, None] * 7.3, at.shape)
    column = np.broadcast_to(3.0 * s, at.shape)
    aside, rise = (2 * noise(row, column + 11 * k, seed + 31 + k) - 1 for k in range(2))
    rise = np.abs(rise) - 0.3  # more outward than inward, where strands would enter the head
    if comb.curl:
        # Tight curls have phases of their own; in waves, the strands of a guide go together.
        own = roots.random[:, 2:3]
        phase = own if comb.pitch < 0.03 else guides.random[guide, 2:3] + 0.12 * own
        angle = 2 * np.pi * (at * length[guide, None] / comb.pitch + phase)
        radius = comb.curl * np.minimum(1, 4 * s) * (0.75 + 0.5 * roots.random[:, 1:2])
        aside = stray * aside + radius * np.sin(angle)
        rise = stray * rise + radius * (1 + np.cos(angle)) * (0.4 if comb.pitch > 0.06 else 1.0)  # waves lie flat
    else:
        aside, rise = stray * aside, stray * rise
    place = centre + kept_distance * (beside[0] * along + beside[1] * across + beside[2] * up)
    return place + aside[..., None] * across + (depth + rise)[..., None] * up, up


def ribbons(width: float, lines: Lines, random: np.ndarray, roll: float) -> Strip:
    """Builds flat ribbons along lines. Tubes would show too much of their sides for strands of many hairs.

    Args:
        width: metres.
        lines: n lines, with normals that the ribbons face.
        random: (n,4) in [0,1]: width, column of the texture, unused here, roll.
        roll: the largest roll about the strand, either way, radians.

    Returns:
        Vertices (V,3), faces (F,3) and uv (V,2); v runs along the strand.
    """
    points, normals = lines
    n, m, _ = points.shape
    s = np.linspace(0, 1, m)
    _, across, up = _line_frames(points, normals)
    turn = roll * (2 * random[:, 3] - 1)[:, None, None]
    half_width = 0.5 * width * (0.7 + 0.6 * random[:, :1]) * np.interp(s, *OUTLINE)
    side = half_width[..., None] * (np.cos(turn) * across + np.sin(turn) * up)
    pairs = np.stack([points - side, points + side], 2)  # vertices 2k and 2k + 1 of a ribbon lie at its point k
    faces = cut_cells(np.arange(2 * n * m).reshape(n, m, 2), "abc", "bdc", by_row=True)
    u = np.clip(random[:, 1, None, None] + HALF_STRIP * np.array([-1.0, 1]), 0, 1)
    uv = np.stack(np.broadcast_arrays(u, 1 - s[None, :, None]), -1).reshape(-1, 2)
    return pairs.reshape(-1, 3), faces, uv
