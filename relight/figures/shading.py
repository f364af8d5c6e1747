"""Bakes soft shading under a bright sky into the albedo, as in scanned textures."""

from dataclasses import replace

import numpy as np

from relight.figures.surfaces import smoothed
from relight.meshes import Mesh
from relight.sh import basis

OVERHEAD = 0.5  # the sky's radiance is 1 + OVERHEAD * y: 1.5 from above, .5 from below
RAYS = 64  # per vertex
SMOOTHINGS = 6  # times the shading is averaged with that of neighbouring vertices


def overhead() -> np.ndarray:
    """Returns the SH coefficients (4,) of a sky with radiance proportional to 1 + OVERHEAD y.

    Its irradiance on an open surface that faces up, pi (1 + 2/3 OVERHEAD) before scaling, is 1.
    """
    # A radiance that is linear in the direction is given by its values in four directions.
    radiance = np.array([1 + OVERHEAD, 1 - OVERHEAD, 1, 1])
    directions = np.array([[0, 1, 0], [0, -1, 0], [1, 0, 0], [0, 0, 1]], float)
    return np.linalg.solve(basis(directions, 1), radiance) / (np.pi * (1 + 2 / 3 * OVERHEAD))


def shaded(mesh: Mesh, strength: float) -> Mesh:
    """Multiplies the corner colors of a mesh by 1 - strength + strength * shading.

    The shading, 0 in the dark and 1 for an open surface facing up, is the irradiance of the sky `overhead`, occluded by
    the figure, averaged over neighbouring vertices.

    Args:
        mesh: mesh of the figure.
        strength: in [0,1]; with 0 the mesh itself is returned.
    """
    if strength == 0:
        return mesh
    from relight.transport import bake_vertices

    shading = bake_vertices(mesh, RAYS, order=1).transport.astype(np.float64) @ overhead()
    shading = smoothed(np.clip(shading, 0, 1), mesh.faces, SMOOTHINGS)
    factor = (1 - strength + strength * shading)[mesh.faces][..., None]
    color = factor.repeat(3, axis=-1) if mesh.color is None else mesh.color * factor
    return replace(mesh, color=color.astype(np.float32), info={**mesh.info, "shading": strength})
