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

MAX_EDGE = 0.03  # over the diagonal; longer edges are split, since radiosity is constant on a face
MIN_RAYS = 16  # per face
RAY_DIVISOR = 4  # rays per pixel over rays per face: a pixel's rays average over hundreds of faces


def solve_radiosity(
    mesh: Mesh, caster: RayCaster, rays: int, order: int, seed: int, bounces: int
) -> tuple[RayCaster, np.ndarray]:
    """Computes the radiosity of the mesh's faces per unit of each coefficient of the light.

    It is rho (T_0 + ... + T_(bounces-1)) on the front of a face, at its centroid and with its geometric normal. Back
    faces reflect nothing: closed meshes hide them, and the inside of open meshes has no albedo.

    Args:
        mesh: for the albedo.
        caster: casts rays at the mesh.
        rays: per pixel; faces get fewer.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.
        seed: random seed of the rays' azimuths.
        bounces: at least 1.

    Returns:
        A ray caster of the mesh with long edges split, and the radiosity (F,K,3) float32 of its faces.
    """
    from trimesh.triangles import points_to_barycentric  # .4 s to import, and figures rarely need it

    split_caster, parent = _split_long_edges(caster)
    has_area = split_caster.areas > 0
    parent, centroid = parent[has_area], split_caster.corners[has_area].mean(1)
    color = sample_albedo(mesh, parent, points_to_barycentric(caster.corners[parent], centroid))[:, None, :]
    normals = split_caster.normals[has_area]
    rays = max(MIN_RAYS, rays // RAY_DIVISOR)
    radiosity: np.ndarray | None = None
    for _ in range(bounces):
        # One seed, other than that of the pixels, casts the same rays at every bounce, so all iterations solve one
        # linear system.
        direct, gathered = integrate(split_caster, centroid, normals, normals, rays, order, seed + 1, radiosity)
        total = direct[..., None] if gathered is None else direct[..., None] + gathered
        radiosity = np.zeros((len(has_area), total.shape[1], 3), np.float32)
        radiosity[has_area] = color * total
    assert radiosity is not None  # bounces is at least 1
    return split_caster, radiosity


def _split_long_edges(caster: RayCaster) -> tuple[RayCaster, np.ndarray]:
    """Returns a caster of the mesh with long edges split, and the original face (F,) of each of its faces."""
    limit = MAX_EDGE * caster.diagonal
    longest = np.linalg.norm(caster.corners - np.roll(caster.corners, 1, 1), axis=2).max(1)
    if (longest <= limit).all():
        return caster, np.arange(len(caster.faces))
    from trimesh.remesh import subdivide_to_size

    vertices_of_faces = caster.corners.reshape(-1, 3)  # each face has its own three
    vertices, faces, parent = subdivide_to_size(
        vertices_of_faces, np.arange(len(vertices_of_faces)).reshape(-1, 3), limit, max_iter=30, return_index=True
    )
    return RayCaster(vertices, faces, caster.threads), parent
