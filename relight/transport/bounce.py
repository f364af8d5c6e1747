"""Interreflection: the light that each face of the mesh sends back, by Jacobi steps of the radiosity equation.

With radiance L = sum L_lm Y_lm from the surroundings, a diffuse face y reflects rho T(y).L / pi, and a point whose
cosine-distributed rays meet faces y_j receives from them T'(x) = 1/N sum_j rho(y_j) T(y_j): the transport of the next
bounce (Sloan, Kautz & Snyder 2002, section 5, without the SH projection in between).
"""

import numpy as np

from relight.meshes.mesh import Mesh
from relight.transport.integrate import integrate
from relight.transport.scene import Scene
from relight.transport.surface import albedo

EDGE = 0.03  # of the diagonal: longer edges are split, since a face reflects as one piece
SHARE = 4  # faces get rays/SHARE: the gather averages over hundreds of them


def reflectors(mesh: Mesh, scene: Scene, rays: int, order: int, seed: int, bounces: int) -> tuple[Scene, np.ndarray]:
    """The scene to gather in, with long edges split, and what each of its faces reflects, (F, K, 3) float32.

    That is rho (T_0 + ... + T_(bounces-1)) of the face's front at its centroid, with its own geometric normal. Backs
    reflect nothing: a closed mesh hides them, and an open sheet has no albedo of its own for the inside.
    """
    fine, parent = _split(scene)
    centroid = fine.corners.mean(1)
    color = albedo(mesh, parent, _barycentric(scene.corners[parent], centroid))[:, None, :]
    alive = fine.areas > 0
    rays = max(16, rays // SHARE)
    reflected = None
    for bounce in range(bounces):
        # The same seed casts the same rays at every bounce: a Jacobi step of one fixed linear system.
        arrived, gathered = integrate(
            fine, centroid[alive], fine.normals[alive], fine.normals[alive], rays, order, seed + 1, reflected
        )
        total = arrived[..., None] if bounce == 0 else arrived[..., None] + gathered
        reflected = np.zeros((len(alive), total.shape[1], 3), np.float32)
        reflected[alive] = color[alive] * total
    return fine, reflected


def _split(scene: Scene) -> tuple[Scene, np.ndarray]:
    """The scene with its long edges split, and the face (F,) of the original that each face lies in."""
    limit = EDGE * scene.diagonal
    longest = np.linalg.norm(scene.corners - np.roll(scene.corners, 1, 1), axis=2).max(1)
    if (longest <= limit).all():
        return scene, np.arange(len(scene.faces))
    from trimesh.remesh import subdivide_to_size  # .4 s to import, and figures rarely need it

    soup = scene.corners.reshape(-1, 3)
    vertices, faces, parent = subdivide_to_size(
        soup, np.arange(len(soup)).reshape(-1, 3), limit, max_iter=30, return_index=True
    )
    return Scene(vertices, faces, scene.threads), parent


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Barycentric weights (N, 3) of `points` (N, 3) in triangles (N, 3, 3); thirds in triangles without area."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    aa, ab, bb = (np.einsum("nx,nx->n", *pair) for pair in ((a, a), (a, b), (b, b)))
    pa, pb = np.einsum("nx,nx->n", p, a), np.einsum("nx,nx->n", p, b)
    area = aa * bb - ab * ab
    flat = area <= 0
    safe = np.where(flat, 1, area)
    v, w = (pa * bb - pb * ab) / safe, (pb * aa - pa * ab) / safe
    weights = np.stack([1 - v - w, v, w], 1)
    weights[flat] = 1 / 3
    return weights
