"""The directions that each point looks in: one cosine-weighted set, turned about each point's normal."""

from functools import cache

import numpy as np

from relight.sh.basis import basis, count


def vogel(rays: int) -> np.ndarray:
    """Cosine-distributed directions (rays, 3) about +z: Vogel's spiral on the disc, lifted to the hemisphere.

    The projection to the disc is uniform (Malley's method), so the mean over the set, times pi, integrates
    against max(z, 0) dw. Its error falls as rays^-.75 at visibility edges, against rays^-.5 of random directions.
    """
    index = np.arange(rays)
    radius, angle = np.sqrt((index + 0.5) / rays), index * (np.pi * (3 - np.sqrt(5)))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], -1)


def azimuths(count: int, seed: int) -> np.ndarray:
    """Seeded angles (count,) in radians, by which the directions of each point are turned about its normal.

    They make the sampling error of neighbours independent: noise, where one shared set would give bands.
    """
    return np.random.default_rng(seed).random(count) * (2 * np.pi)


def frames(normals: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Right-handed frames (P, 3, 3), rows tangent, bitangent, normal, each turned by its azimuth (P,) in radians.

    Tangents after Duff et al. 2017, "Building an Orthonormal Basis, Revisited" (continuous but at z = 0).
    """
    x, y, z = np.asarray(normals, np.float64).T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    tangent = np.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    bitangent = np.stack([b, sign + y * y * a, -y], -1)
    cosine, sine = np.cos(azimuth)[:, None], np.sin(azimuth)[:, None]
    return np.stack([cosine * tangent + sine * bitangent, cosine * bitangent - sine * tangent, normals], 1)


@cache
def lobes(order: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Directions (M, 3), M = 2 order + 1, and for each band l the matrix (2l+1, M) from coefficients to lobe weights.

    Every function of band l is a sum of M zonal lobes of that band at these directions.
    """
    m = 2 * order + 1
    index = np.arange(m) + 0.5
    z = 1 - index / m  # one hemisphere is enough: a band is either even or odd
    angle = index * (np.pi * (3 - np.sqrt(5)))
    radius = np.sqrt(1 - z**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], -1)
    values = basis(directions, order)
    return directions, [np.linalg.pinv(values[:, l * l : (l + 1) ** 2]) for l in range(order + 1)]


def to_world(coefficients: np.ndarray, frame: np.ndarray, order: int) -> np.ndarray:
    """Turns SH coefficients (P, K) given in local frames (P, 3, 3) (rows: axes in the world) into the world's.

    A rotated lobe is a lobe at the rotated direction, so a rotation is M evaluations of the basis per point (after
    Nowrouzezahrai et al. 2012, "Sparse Zonal Harmonic Factorization"), at any order, without Wigner matrices.
    Every point's sums run in an order of their own, whatever the threads and the number of points.
    """
    directions, weights = lobes(order)
    world = np.empty((len(frame), count(order)))
    block = 1 << 12  # fits the cache: twice as fast as all at once
    for start in range(0, len(frame), block):
        part = slice(start, start + block)
        turned = basis(np.matmul(directions, frame[part]), order)
        for l in range(order + 1):
            band = slice(l * l, (l + 1) ** 2)
            lobe = np.einsum("pk,km->pm", coefficients[part, band], weights[l])
            world[part, band] = np.einsum("pm,pmk->pk", lobe, turned[..., band])
    return world
