"""Samples ray directions: one cosine-distributed set, rotated about the normal of each point."""

import numpy as np

from relight.sh import basis, coefficient_count


def vogel_directions(rays: int) -> np.ndarray:
    """Returns cosine-distributed directions (rays,3) about +z: Vogel's spiral on the disc, lifted to the hemisphere.

    The points on the disc are uniform (Malley's method), so pi times the mean over the directions estimates integrals
    with the weight max(z, 0). At visibility edges the error falls as rays^-.75; with random directions, as rays^-.5.
    """
    index = np.arange(rays)
    radius, angle = np.sqrt((index + 0.5) / rays), index * (np.pi * (3 - np.sqrt(5)))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], -1)


def random_azimuths(count: int, seed: int) -> np.ndarray:
    """Returns uniform angles (count,) in radians, by which each point's directions are rotated about its normal.

    They make the sampling errors of neighbouring points independent: noise instead of bands.
    """
    return np.random.default_rng(seed).random(count) * (2 * np.pi)


def tangent_frames(normals: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Returns right-handed frames (P,3,3) with the rows tangent, bitangent, normal.

    They are rotated about the unit normals (P,3) by azimuths (P,) in radians. Tangents follow Duff et al. 2017,
    "Building an Orthonormal Basis, Revisited", and are discontinuous only at z = 0.
    """
    x, y, z = np.asarray(normals, np.float64).T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)  # a and b, as in the paper, are shared by the entries
    b = x * y * a
    tangent = np.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    bitangent = np.stack([b, sign + y * y * a, -y], -1)
    cosine, sine = np.cos(azimuth)[:, None], np.sin(azimuth)[:, None]
    return np.stack([cosine * tangent + sine * bitangent, cosine * bitangent - sine * tangent, normals], 1)


def zonal_lobes(order: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Returns lobe directions for `rotate_to_world`: any function of a band is a sum of zonal lobes at them.

    Returns:
        Directions (M,3), M = 2 order + 1, and for each band l the matrix (2l+1,M) from coefficients to lobe weights.
    """
    m = 2 * order + 1
    index = np.arange(m) + 0.5
    z = 1 - index / m  # one hemisphere is enough, since a band is either even or odd
    azimuth = index * (np.pi * (3 - np.sqrt(5)))  # a golden angle from one to the next
    sine = np.sqrt(1 - z**2)  # of the angle from the pole
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], -1)
    values = basis(directions, order)
    return directions, [np.linalg.pinv(values[:, l * l : (l + 1) ** 2]) for l in range(order + 1)]


def rotate_to_world(coefficients: np.ndarray, frame: np.ndarray, order: int) -> np.ndarray:
    """Rotates coefficients from the frame of each point to the world's.

    A rotated zonal lobe is a lobe at the rotated direction, so a rotation takes M evaluations of the basis per point at
    any order, without Wigner matrices (Nowrouzezahrai et al. 2012, "Sparse Zonal Harmonic Factorization for Efficient
    SH Rotation"). The order of summation depends neither on the number of threads nor on the number of points.

    Args:
        coefficients: (P,K).
        frame: (P,3,3); the rows are the axes of each point's frame in the world.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.

    Returns:
        (P,K) float64.
    """
    directions, weights = zonal_lobes(order)
    rotated = np.empty((len(frame), coefficient_count(order)))
    block_size = 1 << 12  # points; fits the cache, which is twice as fast
    for start in range(0, len(frame), block_size):
        part = slice(start, start + block_size)
        rotated_basis = basis(np.matmul(directions, frame[part]), order)
        for l in range(order + 1):
            band = slice(l * l, (l + 1) ** 2)
            lobe = np.einsum("pk,km->pm", coefficients[part, band], weights[l])
            rotated[part, band] = np.einsum("pm,pmk->pk", lobe, rotated_basis[..., band])
    return rotated
