"""Shading baked into the albedo on purpose, as scanned textures have it: soft occlusion under a bright sky."""

from dataclasses import replace

import numpy as np

from relight.figures.surfaces import smoothed
from relight.meshes import Mesh
from relight.sh import basis

OVERHEAD = 0.5  # the sky's radiance is 1 + OVERHEAD * y: 1.5 from above, .5 from below
RAYS = 64  # of each vertex
SOFTENED = 6  # times the shading is averaged with that of neighbouring vertices


def overhead() -> np.ndarray:
    """Coefficients (4,) of the radiance 1 + OVERHEAD y, and so that an open surface facing up receives 1."""
    radiance = np.array([1 + OVERHEAD, 1 - OVERHEAD, 1, 1])
    directions = np.array([[0, 1, 0], [0, -1, 0], [1, 0, 0], [0, 0, 1]], float)
    return np.linalg.solve(basis(directions, 1), radiance) / (np.pi * (1 + 2 / 3 * OVERHEAD))


def shaded(mesh: Mesh, strength: float) -> Mesh:
    """The mesh with its albedo multiplied by 1 - strength + strength * shading, in its vertex colours.

    The shading (0 in the dark, 1 for an open surface facing up) is the irradiance of the sky `overhead`, occluded by
    the figure, averaged over neighbouring vertices. strength in [0,1]; 0 returns the mesh itself.
    """
    if strength == 0:
        return mesh
    from relight.transport import bake_vertices

    received = bake_vertices(mesh, RAYS, order=1).transport.astype(np.float64) @ overhead()
    received = smoothed(np.clip(received, 0, 1), mesh.faces, SOFTENED)
    before = np.ones((len(mesh.vertices), 3)) if mesh.color is None else mesh.color
    color = before * (1 - strength + strength * received)[:, None]
    return replace(mesh, color=color.astype(np.float32), info={**mesh.info, "shading": strength})
