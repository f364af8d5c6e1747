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
    """Samples the sphere as Blender's lat-long panoramas do: +z is at the top, -x in the leftmost column.

    Returns:
        Directions (rows,2 rows,3), the top row first, and the solid angle (rows,1) of each.
    """
    edges = np.pi * (0.5 - np.arange(rows + 1) / rows)  # elevations between the rows
    elevation = (edges[:-1] + edges[1:]) / 2
    azimuth = np.pi - 2 * np.pi * (np.arange(2 * rows) + 0.5) / (2 * rows)
    horizontal = np.cos(elevation)[:, None]
    z = np.broadcast_to(np.sin(elevation)[:, None], (rows, 2 * rows))
    solid_angle = (np.sin(edges[:-1]) - np.sin(edges[1:])) * np.pi / rows
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), z], -1), solid_angle[:, None]


def light_on(matte, finer=4):
    """Finds the light by which white matte surfaces look as they do.

    Args:
        matte: (rows,2 rows,3) radiance of such a surface by the direction of its normal, as `sphere` samples them: the
            mean over each pixel.
        finer: samples a side by which the basis is averaged over a pixel.

    Returns:
        Radiance coefficients (9,3).
    """
    rows = len(matte)
    values = basis(sphere(rows * finer)[0]).reshape(rows, finer, 2 * rows, finer, 9).mean((1, 3))
    weight = np.sqrt(sphere(rows)[1])[..., None]
    return np.linalg.lstsq((weight * values).reshape(-1, 9), (weight * matte).reshape(-1, 3), rcond=None)[0] / MATTE


def rotation(axes):
    """Returns the matrix (9,9) that takes coefficients to the frame whose axes are the rows of `axes` (3,3)."""
    directions = sphere(8)[0].reshape(-1, 3)
    return np.linalg.lstsq(basis(directions @ np.asarray(axes, np.float64).T), basis(directions), rcond=None)[0]
