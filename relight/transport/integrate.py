"""Computes the transport integral by casting rays from each point."""

import numpy as np

from relight.core.errors import UserError
from relight.core.progress import progress
from relight.sh import basis, coefficient_count, unoccluded
from relight.transport.raycaster import MISS, RayCaster
from relight.transport.sampling import random_azimuths, rotate_to_world, tangent_frames, vogel_directions

BATCH = 1 << 18  # rays per cast, 6 MB; the rate is constant from 2^14


def require_at_least(minimum: int, **settings: int) -> None:
    """Raises UserError for the first of the named settings that is below `minimum`."""
    for name, value in settings.items():
        if value < minimum:
            raise UserError(f"{name} is {value}: it must be at least {minimum}")


def integrate(
    caster: RayCaster,
    points: np.ndarray,
    normals: np.ndarray,
    geometric: np.ndarray,
    rays: int,
    order: int = 2,
    seed: int = 0,
    radiosity: np.ndarray | None = None,
    azimuth: np.ndarray | None = None,
    subset: tuple[int, int] = (0, 1),
) -> tuple[np.ndarray, np.ndarray | None]:
    """Computes the transport T_lm = integral of V(w) max(n.w, 0) Y_lm(w) dw, without 1/pi.

    With N cosine-distributed directions w_j about n,

        T = A_l Y_lm(n) - pi/N sum over blocked w_j of Y_lm(w_j),

    so unoccluded points are exact for any N. The result depends neither on BATCH nor on the number of threads: the
    rays do not, and sums of fixed-point numbers are exact in any order.

    Args:
        caster: casts rays at the mesh that occludes.
        points: (P,3) on the mesh.
        normals: (P,3) unit shading normals n, for the cosine.
        geometric: (P,3) unit normals along which rays start off the surface, for the visibility V.
        rays: N, per point.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.
        seed: random seed of the rays' azimuths.
        radiosity: (F,K,C) of the front of each face, per unit of each coefficient of the light (`solve_radiosity`).
        azimuth: (P,) radians, instead of random ones.
        subset: (j, m) casts only the j-th, (j+m)-th, ... of the N rays, for the m samples of a pixel with one azimuth.
            Every m-th point of Vogel's spiral forms a spiral again, so on smooth surfaces the mean over the samples is
            as accurate as all N rays.

    Returns:
        Transport (P,K) float32, and the gathered radiosity (P,K,C) float32, or None without `radiosity`.

    Raises:
        ValueError: if points or normals are not finite.
    """
    if not all(np.isfinite(array).all() for array in (points, normals, geometric)):
        raise ValueError("points and normals must be finite: Embree calls such rays unoccluded")
    point_count, coefficients = len(points), coefficient_count(order)
    first_ray, ray_step = subset
    directions = vogel_directions(rays)[first_ray::ray_step]
    rays = len(directions)
    local_rays = np.concatenate([np.ones((rays, 1)), directions], 1).astype(np.float32)
    # Multiples of 2^-32: float64 adds 2^20 of them without rounding, so the order does not matter.
    projector = np.round(basis(directions, order) * 2.0**32) / 2.0**32
    frame = tangent_frames(normals, random_azimuths(point_count, seed) if azimuth is None else azimuth)
    start = caster.to_local(points + caster.offset * geometric)
    blocked = np.empty((point_count, coefficients))
    gathered: np.ndarray | None = None
    if radiosity is not None:
        flat = np.ascontiguousarray(radiosity.reshape(len(radiosity), -1), np.float32)
        gathered = np.empty((point_count, flat.shape[1]), np.float32)

    step = max(1, BATCH // rays)
    buffer = np.empty((min(step, point_count), rays, 6), np.float32)
    steps = range(0, point_count, step)
    for begin in progress(steps, "casting rays") if ray_step == 1 else steps:  # of subsets, the caller shows progress
        part = slice(begin, min(begin + step, point_count))
        batch_rays = buffer[: part.stop - begin]
        # One product gives origin and direction: (1, w) @ [[origin, 0], [0, frame]].
        placement = np.zeros((len(batch_rays), 4, 6), np.float32)
        placement[:, 0, :3], placement[:, 1:, 3:] = start[part], frame[part]
        np.matmul(local_rays, placement, out=batch_rays)
        flat_rays = batch_rays.reshape(-1, 6)
        if gathered is None:
            hit = caster.occluded(flat_rays)
        else:
            face, _ = caster.intersect(flat_rays)
            hit = face != MISS
            front = np.zeros(len(hit), bool)  # whether a ray hits the front of its first face
            front[hit] = np.einsum("nx,nx->n", flat_rays[hit, 3:], caster.normals[face[hit]]) < 0
            gathered[part] = _gather(flat, face, front, rays)
        blocked[part] = hit.reshape(-1, rays).astype(np.float64) @ projector

    transport = unoccluded(normals, order) - np.pi / rays * rotate_to_world(blocked, frame, order)
    bounced = None if gathered is None else gathered.reshape(point_count, coefficients, -1)
    return transport.astype(np.float32), bounced


def _gather(radiosity: np.ndarray, face: np.ndarray, front: np.ndarray, rays: int) -> np.ndarray:
    """Averages radiosity over the rays of each point; rays that hit no front face count as zero.

    `radiosity` is (F,M), `face` and `front` are (P * rays,), and the result is (P,M) float32.
    """
    from scipy.sparse import csr_array  # takes .1 s to import, and only bounces need it

    # A sparse matrix (P,F): row p holds 1 / rays for each ray of point p that hits the front of a face, in its column.
    row_ends = np.concatenate([[0], np.cumsum(front.reshape(-1, rays).sum(1))])
    columns = face[front].astype(np.int32)
    weights = np.full(len(columns), 1 / rays, np.float32)
    return csr_array((weights, columns, row_ends), shape=(len(row_ends) - 1, len(radiosity))) @ radiosity
