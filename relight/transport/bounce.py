"""Interreflection: the radiosity of the mesh's faces, by Jacobi iterations of the radiosity equation.

With radiance L = sum L_lm Y_lm from the surroundings, a diffuse face y reflects rho T(y).L / pi, and a point whose
cosine-distributed rays meet faces y_j receives from them T'(x) = 1/N sum_j rho(y_j) T(y_j): the transport of the next
bounce (Sloan, Kautz & Snyder 2002, section 5, without the SH projection in between).
"""

import numpy as np

from relight.meshes import Mesh
from relight.transport.integrate import integrate
from relight.transport.raycaster import RayCaster
from relight.transport.surface import sample_albedo

MAX_EDGE = 0.03  # of the diagonal: longer edges are split, since the radiosity of a face is constant
FEWER = 4  # times fewer rays per face than per pixel: a pixel's rays average over hundreds of faces


def solve_radiosity(
    mesh: Mesh, caster: RayCaster, rays: int, order: int, seed: int, bounces: int
) -> tuple[RayCaster, np.ndarray]:
    """Computes the radiosity of the mesh's faces per unit of each coefficient of the light.

    It is rho (T_0 + ... + T_(bounces-1)) on the front of a face, at its centroid and with its geometric normal. Backs
    reflect nothing: closed meshes hide them, and for the inside of open ones there is no albedo.

    Args:
        mesh: for the albedo.
        caster: of the mesh.
        rays: per pixel; faces get fewer.
        order: of the spherical harmonics.
        seed: of the rays' azimuths.
        bounces: at least 1.

    Returns:
        A caster whose faces are split where they are large, and the radiosity (F,K,3) float32 of its faces.
    """
    fine, parent = _with_short_edges(caster)
    centroid = fine.corners.mean(1)
    color = sample_albedo(mesh, parent, _barycentric(caster.corners[parent], centroid))[:, None, :]
    solid = fine.areas > 0
    rays = max(16, rays // FEWER)
    reflected: np.ndarray | None = None
    for _ in range(bounces):
        # The same seed casts the same rays at every bounce, so all iterations are of one linear system.
        direct, gathered = integrate(
            fine, centroid[solid], fine.normals[solid], fine.normals[solid], rays, order, seed + 1, reflected
        )
        total = direct[..., None] if gathered is None else direct[..., None] + gathered
        reflected = np.zeros((len(solid), total.shape[1], 3), np.float32)
        reflected[solid] = color[solid] * total
    assert reflected is not None  # bounces is at least 1
    return fine, reflected


def _with_short_edges(caster: RayCaster) -> tuple[RayCaster, np.ndarray]:
    """Splits long edges; also returns the original face (F,) that each face lies in."""
    limit = MAX_EDGE * caster.diagonal
    longest = np.linalg.norm(caster.corners - np.roll(caster.corners, 1, 1), axis=2).max(1)
    if (longest <= limit).all():
        return caster, np.arange(len(caster.faces))
    from trimesh.remesh import subdivide_to_size  # .4 s to import, and figures rarely need it

    soup = caster.corners.reshape(-1, 3)
    vertices, faces, parent = subdivide_to_size(
        soup, np.arange(len(soup)).reshape(-1, 3), limit, max_iter=30, return_index=True
    )
    return RayCaster(vertices, faces, caster.threads), parent


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Returns barycentric weights (N,3) of points (N,3) in triangles (N,3,3); thirds in triangles without area."""
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
