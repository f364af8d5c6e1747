"""Clusters of lights, their medoids, and the split into training, validation and test lights."""

import math
from typing import TYPE_CHECKING

import numpy as np

from relight.sh import cosine_factors, order_of, per_coefficient

if TYPE_CHECKING:
    from relight.settings import Lights

VALIDATION = 0.1  # share of the lights for training that are left out of it for the validation
MAX_VALIDATION = 8  # lights


def irradiance_features(lights: np.ndarray) -> np.ndarray:
    """Maps lights (N,K,3) to points (N,3K), whose distances are the L2 distances of irradiance over all normals.

    This holds since irradiance has the coefficients A_l L_lm in an orthonormal basis.
    """
    weight = per_coefficient(cosine_factors(order_of(lights.shape[1])))
    return (np.asarray(lights, np.float64) * weight[:, None]).reshape(len(lights), -1)


def medoids(lights: np.ndarray, sources: np.ndarray, clusters: int, seed: int) -> np.ndarray:
    """Clusters lights by k-means and returns the medoid of each cluster.

    The mean itself would be a blurred light. All panoramas have the same total weight, since soft lights keep copies
    at all headings and directed ones only at a few. A panorama gives at most one medoid or, with more clusters than
    panoramas, the fewest possible. Small clusters choose first, since they have the fewest panoramas to choose from.

    Args:
        lights: (N,K,3).
        sources: (N,) the panorama of each light.
        clusters: the largest number of medoids.
        seed: random seed of k-means.

    Returns:
        Indices (M,) of the medoids, ascending, with M <= `clusters`.
    """
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    points = irradiance_features(lights)
    clusters = min(clusters, len(np.unique(points.round(9), axis=0)))
    _, source_index, source_counts = np.unique(sources, return_inverse=True, return_counts=True)
    max_per_source = math.ceil(clusters / len(source_counts))
    with threadpool_limits(1):  # for the same order of sums on every machine
        kmeans = KMeans(clusters, random_state=seed, n_init=2, max_iter=60)
        kmeans.fit(points, sample_weight=1 / source_counts[source_index])
    distance = np.linalg.norm(points - kmeans.cluster_centers_[kmeans.labels_], axis=1)
    medoids_per_source: dict[str, int] = {}
    selected = []
    for label in np.argsort(np.bincount(kmeans.labels_, minlength=clusters), kind="stable"):
        members = np.flatnonzero(kmeans.labels_ == label)
        for i in members[np.argsort(distance[members], kind="stable")]:
            if medoids_per_source.get(sources[i], 0) < max_per_source:
                medoids_per_source[sources[i]] = medoids_per_source.get(sources[i], 0) + 1
                selected.append(i)
                break
    return np.sort(selected)


def farthest_first(points: np.ndarray) -> np.ndarray:
    """Orders points (N,D) by farthest-first traversal, from the point that is farthest from the mean.

    Returns:
        Indices (N,); each point is the farthest from all points before it.

    >>> farthest_first(np.array([[0.0], [1.0], [9.0]])).tolist()
    [2, 0, 1]
    """
    order = [int(np.linalg.norm(points - points.mean(0), axis=1).argmax())]
    nearest = np.linalg.norm(points - points[order[0]], axis=1)
    for _ in range(len(points) - 1):
        nearest[order[-1]] = -1
        order.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[order[-1]], axis=1))
    return np.array(order)


def choose_test_lights(lights: np.ndarray, sources: np.ndarray, settings: "Lights") -> np.ndarray:
    """Chooses the test lights: a share `settings.test` / `settings.clusters` of all lights, at least one.

    If `settings.split` is `random`, they are drawn at random. If it is `room`, all lights of a panorama are on one side
    of the split, and the test panoramas are spaced evenly in farthest-first order to span the set. Lights of a single
    panorama are split at random.

    Args:
        lights: (N,K,3).
        sources: (N,) the panorama of each light.
        settings: test, clusters, split and seed.

    Returns:
        (N,) bool, true for test lights.
    """
    n = len(lights)
    test_count = settings.test if n >= settings.clusters else max(1, round(n * settings.test / settings.clusters))
    test = np.zeros(n, bool)
    if settings.split == "random" or len(np.unique(sources)) == 1:
        test[np.random.default_rng(settings.seed).permutation(n)[:test_count]] = True
        return test
    panoramas = list(dict.fromkeys(sources[farthest_first(irradiance_features(lights))].tolist()))
    stride = len(panoramas) / test_count
    # Every `stride`-th panorama, then the others, until there are enough lights; one panorama is left for training.
    evenly_spaced = list(dict.fromkeys(int((i + 0.5) * stride) for i in range(test_count)))
    queue = evenly_spaced + [i for i in range(len(panoramas)) if i not in evenly_spaced]
    for i in queue[: len(panoramas) - 1]:
        if test.sum() >= test_count:
            break
        test |= sources == panoramas[i]
    return test


def choose_validation_lights(lights: np.ndarray) -> np.ndarray:
    """Returns the indices (C,) of a few of the lights (N,K,3) for training, spaced evenly in farthest-first order.

    One light is left for the training.
    """
    if (n := len(lights)) < 2:
        return np.zeros(0, int)
    count = min(MAX_VALIDATION, max(1, round(VALIDATION * n)))
    return farthest_first(irradiance_features(lights))[((np.arange(count) + 0.5) * n / count).astype(int)]
