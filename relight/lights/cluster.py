"""Clusters of lights, their medoids, and the split into training and test lights."""

import math

import numpy as np

from relight.config import Lights
from relight.sh import cosine_factors, order_of, per_coefficient


def irradiance_features(lights: np.ndarray) -> np.ndarray:
    """Maps lights (N,K,3) to points (N,3K) whose distances are the L2 distances of the lights' irradiance.

    The irradiance on the sphere of normals has the coefficients A_l L_lm, and the basis is orthonormal.
    """
    weight = per_coefficient(cosine_factors(order_of(lights.shape[1])))
    return (np.asarray(lights, np.float64) * weight[:, None]).reshape(len(lights), -1)


def medoids(lights: np.ndarray, sources: np.ndarray, clusters: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Finds k-means clusters of lights and the light nearest to the mean of each.

    The mean itself would be a blurred light. All panoramas have the same weight, no matter how many of their copies
    are left: soft light passes the rules at all headings, light from one side only at a few. A panorama gives at most
    one medoid, or the fewest possible where there are more clusters than panoramas. Small clusters choose first, as
    they have the fewest panoramas to choose from.

    Args:
        lights: (N,K,3).
        sources: (N,) the panorama of each light.
        clusters: the largest number of medoids.
        seed: of k-means.

    Returns:
        Indices (M,) of the medoids, ascending, and the cluster (M,) of each, with M <= `clusters`.
    """
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    points = irradiance_features(lights)
    clusters = min(clusters, len(np.unique(points.round(9), axis=0)))
    _, source, copies = np.unique(sources, return_inverse=True, return_counts=True)
    each = math.ceil(clusters / len(copies))
    with threadpool_limits(1):  # the same sums in the same order on every machine
        means = KMeans(clusters, random_state=seed, n_init=2, max_iter=60)
        means.fit(points, sample_weight=1 / copies[source])
    distance = np.linalg.norm(points - means.cluster_centers_[means.labels_], axis=1)
    taken: dict[str, int] = {}
    chosen = []
    for label in np.argsort(np.bincount(means.labels_, minlength=clusters), kind="stable"):
        members = np.flatnonzero(means.labels_ == label)
        for i in members[np.argsort(distance[members], kind="stable")]:
            if taken.get(sources[i], 0) < each:
                taken[sources[i]] = taken.get(sources[i], 0) + 1
                chosen.append((i, label))
                break
    chosen.sort()
    return np.array([i for i, _ in chosen]), np.array([label for _, label in chosen])


def farthest_first(points: np.ndarray) -> np.ndarray:
    """Orders points (N,D) by farthest-first traversal, from the point that is farthest from the mean.

    Returns:
        Indices (N,): each point is the farthest from all points before it.

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


def choose_test_lights(lights: np.ndarray, sources: np.ndarray, settings: Lights) -> np.ndarray:
    """Chooses the test lights, a share `settings.test` / `settings.clusters` of all and at least one.

    With `settings.split` = `random` they are drawn at random. With `room`, all lights of a panorama are on the same
    side of the split, and the test panoramas are spaced evenly in farthest-first order, so that they span the set.
    Lights of a single panorama are split at random.

    Args:
        lights: (N,K,3).
        sources: (N,) the panorama of each light.
        settings: test, clusters, split and seed.

    Returns:
        (N,) bool, true for test lights.
    """
    n = len(lights)
    wanted = settings.test if n >= settings.clusters else max(1, round(n * settings.test / settings.clusters))
    test = np.zeros(n, bool)
    if settings.split == "random" or len(np.unique(sources)) == 1:
        test[np.random.default_rng(settings.seed).permutation(n)[:wanted]] = True
        return test
    ordered = sources[farthest_first(irradiance_features(lights))]
    _, first = np.unique(ordered, return_index=True)
    rooms = ordered[np.sort(first)]
    stride = len(rooms) / wanted
    # Every `stride`-th room, then the others, until there are enough lights; one room is left for training.
    even = list(dict.fromkeys(int((i + 0.5) * stride) for i in range(wanted) if (i + 0.5) * stride < len(rooms)))
    queue = even + [i for i in range(len(rooms)) if i not in even]
    for i in queue[: len(rooms) - 1]:
        if test.sum() >= wanted:
            break
        test |= sources == rooms[i]
    return test
