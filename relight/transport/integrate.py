"""The integral: transport vectors of points by casting each point's rays."""

import numpy as np

from relight.files import UserError
from relight.progress import progress
from relight.sh.basis import basis, count
from relight.sh.irradiance import unoccluded
from relight.transport.sampling import azimuths, frames, to_world, vogel
from relight.transport.scene import MISS, Scene

BATCH = 1 << 18  # rays per cast: 6 MB; the rate is flat from 2^14 up


def at_least(least: int, **settings: int) -> None:
    """UserError that names the first of `settings` below `least`."""
    for name, value in settings.items():
        if value < least:
            raise UserError(f"{name} is {value}: it must be at least {least}")


def integrate(
    scene: Scene,
    points: np.ndarray,
    normals: np.ndarray,
    geometric: np.ndarray,
    rays: int,
    order: int = 2,
    seed: int = 0,
    radiosity: np.ndarray | None = None,
    batch: int = BATCH,
    azimuth: np.ndarray | None = None,
    share: tuple[int, int] = (0, 1),
) -> tuple[np.ndarray, np.ndarray | None]:
    """Transport T_lm = integral of V(w) max(n.w, 0) Y_lm(w) dw at `points` (P, 3), as (P, K) float32. No 1/pi.

    `normals` (P, 3) are unit shading normals (the cosine); rays start off the surface along the unit `geometric`
    normals (P, 3) (the visibility). With the Vogel directions w_j about n,

        T = A_l Y_lm(n) - pi/N sum over blocked w_j of Y_lm(w_j),

    so that points which nothing occludes are exact at any N. The same `seed` gives the same bits whatever `batch`
    and the thread count: rays don't depend on either, and sums are of fixed-point numbers, exact in any order.

    `radiosity` (F, K, C): what each face of the scene sends back per unit of light, front side only (see bounce.py);
    the second result is then its gathered transport (P, K, C) float32, else None.

    Points that share one set of rays, as the places of a pixel do, are given its `azimuth` (P,) in radians in place of
    the seed's, and `share` = (j, m): of the directions the j-th, (j+m)-th, ... only. Every m-th point of Vogel's spiral
    is again a spiral, so the mean over the m places is as even as the whole set where the surface is.
    """
    if not all(np.isfinite(array).all() for array in (points, normals, geometric)):
        raise ValueError("points and normals must be finite: Embree calls such rays unoccluded")
    total, coefficients = len(points), count(order)
    directions = vogel(rays)[share[0] :: share[1]]
    rays = len(directions)
    spread = np.concatenate([np.ones((rays, 1)), directions], 1).astype(np.float32)
    # Multiples of 2^-32: float64 adds up to 2^20 of them without rounding, hence in any order.
    projector = np.round(basis(directions, order) * 2.0**32) / 2.0**32
    frame = frames(normals, azimuths(total, seed) if azimuth is None else azimuth)
    start = scene.local(points + scene.offset * geometric)
    blocked = np.empty((total, coefficients))
    gathered = None
    if radiosity is not None:
        channels = radiosity.shape[2]
        flat = np.ascontiguousarray(radiosity.reshape(len(radiosity), -1), np.float32)
        gathered = np.empty((total, flat.shape[1]), np.float32)

    step = max(1, batch // rays)
    buffer = np.empty((min(step, total), rays, 6), np.float32)
    steps = range(0, total, step)
    for begin in progress(steps, "casting rays") if share[1] == 1 else steps:  # who shares rays counts the shares
        part = slice(begin, min(begin + step, total))
        bundle = buffer[: part.stop - begin]
        # One product makes origin and direction: (1, w) @ [[origin, 0], [0, frame]].
        placement = np.zeros((len(bundle), 4, 6), np.float32)
        placement[:, 0, :3], placement[:, 1:, 3:] = start[part], frame[part]
        np.matmul(spread, placement, out=bundle)
        flat_rays = bundle.reshape(-1, 6)
        if radiosity is None:
            hit = scene.occluded(flat_rays)
        else:
            face, front = _front(scene, flat_rays)
            hit = face != MISS
            gathered[part] = _gather(flat, face, front, rays)
        blocked[part] = hit.reshape(-1, rays).astype(np.float64) @ projector

    transport = unoccluded(normals, order) - np.pi / rays * to_world(blocked, frame, order)
    if gathered is not None:
        gathered = gathered.reshape(total, coefficients, channels)
    return transport.astype(np.float32), gathered


def _front(scene: Scene, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The face that each ray meets, and whether it meets its front."""
    face, _ = scene.first(rays)
    hit = np.flatnonzero(face != MISS)
    front = np.zeros(len(rays), bool)
    front[hit] = np.einsum("nx,nx->n", rays[hit, 3:], scene.normals[face[hit]]) < 0
    return face, front


def _gather(radiosity: np.ndarray, face: np.ndarray, front: np.ndarray, rays: int) -> np.ndarray:
    """The mean of `radiosity` (F, M) over each point's rays, as (P, M); rays that meet no front count as zero."""
    from scipy.sparse import csr_array  # .1 s to import, and only bounces need it

    ends = np.concatenate([[0], np.cumsum(front.reshape(-1, rays).sum(1))])
    used = face[front]
    weights = np.full(len(used), 1 / rays, np.float32)
    return csr_array((weights, used.astype(np.int32), ends), shape=(len(ends) - 1, len(radiosity))) @ radiosity
