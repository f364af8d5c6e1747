"""Light and transport in spherical harmonics of order 2.

The harmonics are those of relight: real, orthonormal, without the Condon-Shortley phase, index l*l + l + m, pole +z.
"""

import numpy as np

MATTE = np.repeat([1, 2 / 3, 1 / 4], [1, 3, 5])[:, None]  # what a matte surface keeps of each coefficient (9,1)


class Problem(Exception):
    """What the user has to know, in one sentence."""


def basis(directions):
    """Returns the harmonics Y_lm (...,9) of order 2 of unit vectors (...,3), index l*l + l + m."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    values = [0.28209479 * np.ones_like(x), 0.48860251 * y, 0.48860251 * z, 0.48860251 * x]
    values += [1.09254843 * x * y, 1.09254843 * y * z, 0.31539157 * (3 * z * z - 1), 1.09254843 * x * z]
    return np.stack([*values, 0.54627422 * (x * x - y * y)], -1)


def sphere(rows):
    """Returns directions (rows,2 rows,3) as in Blender's lat-long panoramas: the top row is near +z, -x at the left."""
    elevation = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    azimuth = np.pi - np.pi * (np.arange(2 * rows) + 0.5) / rows
    x, y, z = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    return np.stack([x, y, np.broadcast_to(z, x.shape)], -1)


def light_on(matte):
    """Returns the light (9,3) of the radiance (rows,2 rows,3) of white matte surfaces by normal, and its RMS error."""
    rows = len(matte)
    size = np.sin(np.pi * (np.arange(rows) + 0.5) / rows)[:, None, None] * (np.pi / rows) ** 2  # of a pixel, in sr
    kept = np.tensordot(basis(sphere(rows)), size * matte, ((0, 1), (0, 1)))
    lost = np.sqrt(max((size * matte**2).sum() - (kept**2).sum(), 0) / 12 / np.pi)
    return kept / MATTE, lost / max(matte.max(), 1e-9)


def rotation(axes):
    """Returns the matrix (9,9) that takes coefficients to the frame whose axes are the rows of `axes` (3,3)."""
    directions = sphere(8).reshape(-1, 3)
    return np.linalg.lstsq(basis(directions @ np.asarray(axes, np.float64).T), basis(directions), rcond=None)[0]
