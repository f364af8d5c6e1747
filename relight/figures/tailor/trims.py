"""Accessories on draped clothes: belts, ties, and the band of a closed front."""

import numpy as np
import scipy.sparse as sparse
from scipy.ndimage import gaussian_filter1d, maximum_filter

from relight.figures.cloth.colliders import Collider
from relight.figures.surfaces import Surface, clip, extruded, grid_faces, normals, thickened
from relight.figures.tailor.patterns import Pattern

BANDS = {"zip": (-0.013, 0.013), "buttons": (-0.018, 0.018), "placket": (-0.017, 0.017), "double": (-0.030, 0.085)}
PLACKET = 0.15  # length of a placket, metres
OFFSET = 0.0025  # metres between the cloth and a band, a belt or a tie; also their thickness
BEARINGS = 72  # around a belt
TIE = 0.48  # metres of a tie
KNOT = 0.035  # metres of its knot


def band(pattern: Pattern, positions: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Builds the raised band of a closed front.

    Args:
        pattern: of the garment.
        positions: (n,3) finest vertices as draped, metres.
        uv: (n,2) of these vertices.

    Returns:
        Vertices, faces and corner uv; None if the garment has no such band.
    """
    garment, level = pattern.garment, pattern.levels[-1]
    if garment.front not in BANDS:
        return None
    low, high = BANDS[garment.front]
    p = level.rest_shape
    x, z = p[:, 0], p[:, 2]
    ahead = (z > np.median(z)) & (np.abs(x) < 0.2)
    faces = level.faces[ahead[level.faces].all(1) & ~pattern.sleeve]
    matrix = sparse.identity(len(p), format="csr")
    fields = [x - low, high - x]
    if garment.front == "placket":
        top = p[np.unique(faces)][np.abs(p[np.unique(faces), 0]) < 0.02, 1].max(initial=-9)
        fields.append(p[:, 1] - top + PLACKET)
    for field in fields:
        if not len(faces):
            return None
        matrix, faces = clip(matrix, faces, matrix @ field, snap=0.2)
    flat = matrix @ positions
    out = flat + OFFSET * normals(flat, faces)
    points, shell, source = thickened(out, faces, OFFSET, rings=None)
    return points, shell, (matrix @ uv)[source][shell]


def belt(vertices: np.ndarray, faces: np.ndarray, band: np.ndarray, ahead: np.ndarray, width: float) -> list[Surface]:
    """Builds a belt over a garment, and its buckle.

    Args:
        vertices: (n,3) of the garment, metres.
        faces: (F,3).
        band: (k,3) points of the garment at the belt, metres.
        ahead: (3,) direction in which the pelvis faces.
        width: of the belt, metres.

    Returns:
        Belt and buckle; nothing if the cloth does not go all around.
    """
    centre = band.mean(0)
    up = np.linalg.svd(band - centre)[2][2]
    up = up * np.sign(up[1])
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    left, surface = np.cross(up, ahead), Collider(vertices, vertices, faces)
    turn = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    out = np.outer(np.cos(turn), ahead) + np.outer(np.sin(turn), left)
    heights = np.linspace(-0.5, 0.5, 4) * width
    far = 1.25 * np.linalg.norm(band - centre, axis=1).max() + 0.03
    depth = np.stack([surface.raycast(centre + h * up + far * out, -out)[1] for h in heights])
    radius = far - depth
    if not np.isfinite(radius).all() or (radius < 0.3 * far).any():
        return []
    radius = maximum_filter(radius, 3, mode=("nearest", "wrap"))  # follows the cloth closely
    radius = gaussian_filter1d(radius, 1.0, mode="wrap") + OFFSET
    rings = [centre + h * up + r[:, None] * out for h, r in zip(heights[::-1], radius[::-1])]
    radius = radius.max(0)
    strip, loop = extruded(np.arange(BEARINGS), rings[1:], BEARINGS, True)
    points = np.concatenate([rings[0], strip])
    ribbon = thickened(points, loop, OFFSET, rings=None)[:2]
    x, y = np.meshgrid(np.linspace(-0.026, 0.026, 5), np.linspace(0.62, -0.62, 3) * width)
    at = np.interp(x / radius[0], turn - 2 * np.pi * (turn > np.pi), radius, period=2 * np.pi) + 0.003
    plate = centre + y[..., None] * up + x[..., None] * left + np.sqrt(np.maximum(at**2 - x**2, 0))[..., None] * ahead
    face = grid_faces(*x.shape)
    return [ribbon, thickened(plate.reshape(-1, 3), face, 0.003, rings=None)[:2]]


def tie(vertices: np.ndarray, faces: np.ndarray, neck: np.ndarray, left: np.ndarray) -> Surface | None:
    """Builds a tie on a shirt's front, from the collar down.

    Args:
        vertices: (n,3) of the shirt, metres.
        faces: (F,3) without sleeves.
        neck: (3,) base of the posed neck, metres.
        left: (3,) axis to its left.

    Returns:
        Vertices and faces; None if the shirt's front is not found.
    """
    surface = Collider(vertices, vertices, faces)
    s = np.linspace(0, TIE, 40)
    half = np.interp(s, [0, KNOT, KNOT + 0.006, 0.8 * TIE, 0.9 * TIE, TIE], [0.017, 0.014, 0.013, 0.036, 0.036, 0.002])
    across = np.linspace(-1, 1, 7)
    top = neck + 0.02 * np.array([0.0, 1.0, 0.0])
    origin = top + (half[:, None] * across)[..., None] * left + [0.0, 0.0, 0.6]
    origin[..., 1] -= s[:, None]
    depth = surface.raycast(origin.reshape(-1, 3), np.broadcast_to([0.0, 0.0, -1.0], (origin.size // 3, 3)))[1]
    depth = depth.reshape(origin.shape[:2])
    whole = np.isfinite(depth).all(1) & (depth < 0.6).all(1)
    if whole[KNOT < s].sum() < 25:
        return None
    first, last = np.flatnonzero(whole)[[0, -1]]
    rows = slice(first, last + 1)
    depth = np.where(np.isfinite(depth), depth, np.nanmin(np.where(np.isfinite(depth), depth, np.nan)))[rows]
    depth = np.minimum(gaussian_filter1d(depth, 1.5, axis=0, mode="nearest"), depth)
    knot = 0.011 * np.exp(-(((s[rows] - 0.4 * KNOT) / (0.6 * KNOT)) ** 2))[:, None] * (1 - 0.5 * across**2)
    points = origin[rows] - np.array([0.0, 0.0, 1.0]) * (depth - 2 * OFFSET - knot)[..., None]
    face = grid_faces(*points.shape[:2])
    return thickened(points.reshape(-1, 3), face, OFFSET, rings=None)[:2]
