"""Accessories on draped clothes: belts, ties, and the band of a closed front."""

import numpy as np
import scipy.sparse as sparse
from scipy.ndimage import gaussian_filter1d, maximum_filter

from relight.figures.cut.patterns import Pattern
from relight.figures.drape.collars import VERTICAL, Neck
from relight.figures.drape.colliders import Collider
from relight.figures.surfaces import Surface, Textured, clip, extruded, grid_faces, normals, thickened

# Right and left edge of the band of each closed front on the pattern, metres from the middle.
BANDS = {"zip": (-0.013, 0.013), "buttons": (-0.018, 0.018), "placket": (-0.017, 0.017), "double": (-0.030, 0.085)}
PLACKET = 0.15  # length of a placket, metres
OFFSET = 0.0025  # metres between the cloth and a band, a belt or a tie; also their thickness
BEARINGS = 72  # around a belt
HALF_BUCKLE = 0.026  # half the width of a buckle, metres
BUCKLE_OFFSET = 0.003  # metres of a buckle before its belt; also its thickness
TIE = 0.48  # metres of a tie
KNOT = 0.035  # metres of its knot
TIE_OUTLINE = (  # metres below the top, and half the width there
    (0, KNOT, KNOT + 0.006, 0.8 * TIE, 0.9 * TIE, TIE),
    (0.017, 0.014, 0.013, 0.036, 0.036, 0.002),
)
TIE_RAYS = 0.6  # metres before the neck where rays toward the shirt start
TIE_ROWS = 40
MIN_TIE_ROWS = 25  # of these that must meet the shirt below the knot


def band(pattern: Pattern, positions: np.ndarray, uv: np.ndarray) -> Textured | None:
    """Builds the raised band of a closed front.

    Args:
        pattern: pattern of the garment.
        positions: (n,3) finest vertices as draped, metres.
        uv: (n,2) of these vertices.

    Returns:
        Vertices (V,3), faces (F,3) and corner uv (F,3,2); None if the garment has no such band.
    """
    garment, level = pattern.garment, pattern.levels[-1]
    if garment.front not in BANDS:
        return None
    right, left = BANDS[garment.front]
    x, y, z = level.rest_shape.T
    ahead = (z > np.median(z)) & (np.abs(x) < 0.2)
    faces = level.faces[ahead[level.faces].all(1) & ~pattern.sleeve]
    matrix = sparse.identity(len(x), format="csr")
    fields = [x - right, left - x]  # each is positive on the band
    if garment.front == "placket":
        used = np.unique(faces)
        top = y[used][np.abs(x[used]) < 0.02].max(initial=-9)
        fields.append(y - top + PLACKET)
    for field in fields:
        if not len(faces):
            return None
        matrix, faces = clip(matrix, faces, matrix @ field, snap=0.2)
    flat = matrix @ positions
    points, shell, corner = thickened(flat + OFFSET * normals(flat, faces), faces, OFFSET, rings=None)
    return points, shell, (matrix @ uv)[faces.ravel()[corner]]


def belt(vertices: np.ndarray, faces: np.ndarray, band: np.ndarray, ahead: np.ndarray, width: float) -> list[Surface]:
    """Builds a belt over a garment, and its buckle.

    Args:
        vertices: (n,3) of the garment, metres.
        faces: (F,3).
        band: (k,3) points of the garment at the belt, metres.
        ahead: (3,) direction in which the pelvis faces.
        width: width of the belt, metres.

    Returns:
        Vertices and faces of belt and buckle; nothing if the cloth does not go all around.
    """
    centre = band.mean(0)
    up = np.linalg.svd(band - centre)[2][2]  # normal of the plane that fits the belt
    up = up * np.sign(up[1])
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    left, surface = np.cross(up, ahead), Collider.at_rest(vertices, faces)
    bearing = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    outward = np.outer(np.cos(bearing), ahead) + np.outer(np.sin(bearing), left)
    heights = np.linspace(-0.5, 0.5, 4) * width
    far = 1.25 * np.linalg.norm(band - centre, axis=1).max() + 0.03  # metres from the centre, outside the cloth
    depth = np.stack([surface.raycast(centre + h * up + far * outward, -outward)[1] for h in heights])
    radius = far - depth
    if not np.isfinite(radius).all() or (radius < 0.3 * far).any():
        return []
    radius = maximum_filter(radius, 3, mode=("nearest", "wrap"))  # follows the cloth closely
    radius = gaussian_filter1d(radius, 1.0, mode="wrap") + OFFSET
    rings = [centre + h * up + r[:, None] * outward for h, r in zip(heights[::-1], radius[::-1])]
    strip, strip_faces = extruded(np.arange(BEARINGS), rings[1:], offset=BEARINGS, closed=True)
    ribbon = thickened(np.concatenate([rings[0], strip]), strip_faces, OFFSET, rings=None)[:2]
    # The buckle: a plate as bent as the belt, a little wider and 3 mm before it.
    outer_radius = radius.max(0)
    x, y = np.meshgrid(np.linspace(-HALF_BUCKLE, HALF_BUCKLE, 5), np.linspace(0.62, -0.62, 3) * width)
    signed_bearing = bearing - 2 * np.pi * (bearing > np.pi)
    plate_radius = np.interp(x / outer_radius[0], signed_bearing, outer_radius, period=2 * np.pi) + BUCKLE_OFFSET
    forward = np.sqrt(np.maximum(plate_radius**2 - x**2, 0))
    plate = centre + y[..., None] * up + x[..., None] * left + forward[..., None] * ahead
    return [ribbon, thickened(plate.reshape(-1, 3), grid_faces(*x.shape), BUCKLE_OFFSET, rings=None)[:2]]


def tie(vertices: np.ndarray, faces: np.ndarray, neck: Neck) -> Surface | None:
    """Builds a tie on a shirt's front, from the collar down.

    Args:
        vertices: (n,3) of the shirt, metres.
        faces: (F,3) without sleeves.
        neck: of the posed figure.

    Returns:
        Vertices (V,3) and faces (F,3); None if the shirt's front is not found.
    """
    surface = Collider.at_rest(vertices, faces)
    s = np.linspace(0, TIE, TIE_ROWS)  # metres below the top
    half_width = np.interp(s, *TIE_OUTLINE)
    across = np.linspace(-1, 1, 7)
    # Rays from in front give the depth of the shirt at each point of the tie.
    origin = neck.base + TIE_RAYS * neck.ahead + (0.02 - s)[:, None, None] * VERTICAL
    origin = origin + (half_width[:, None] * across)[..., None] * neck.aside
    depth = surface.raycast(origin.reshape(-1, 3), -neck.ahead)[1].reshape(origin.shape[:2])
    is_on_shirt = np.asarray(np.isfinite(depth).all(1) & (depth < TIE_RAYS).all(1))
    if is_on_shirt[KNOT < s].sum() < MIN_TIE_ROWS:
        return None
    first, last = np.flatnonzero(is_on_shirt)[[0, -1]]
    rows = slice(first, last + 1)
    least_depth = np.nanmin(np.where(np.isfinite(depth), depth, np.nan))
    depth = np.where(np.isfinite(depth), depth, least_depth)[rows]
    depth = np.minimum(gaussian_filter1d(depth, 1.5, axis=0, mode="nearest"), depth)  # over folds, not into them
    knot = 0.011 * np.exp(-(((s[rows] - 0.4 * KNOT) / (0.6 * KNOT)) ** 2))[:, None] * (1 - 0.5 * across**2)
    points = origin[rows] - neck.ahead * (depth - 2 * OFFSET - knot)[..., None]
    return thickened(points.reshape(-1, 3), grid_faces(*points.shape[:2]), OFFSET, rings=None)[:2]
