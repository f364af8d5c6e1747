"""Clusters of lights, the light that stands for each, and the split into training and test lights."""

import math

import numpy as np

from relight.config import Lights
from relight.sh.basis import cosine_factors, order_of, per_coefficient


def features(lights: np.ndarray) -> np.ndarray:
    """Lights (N, K, 3) as points (N, 3K) whose distance is the L2 distance of their irradiance over the sphere."""
    weight = per_coefficient(cosine_factors(order_of(lights.shape[1])))
    return (np.asarray(lights, np.float64) * weight[:, None]).reshape(len(lights), -1)


def medoids(lights: np.ndarray, sources: np.ndarray, clusters: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """K-means, then the light nearest to each centre: indices (M,) and the cluster of each, M <= `clusters`.

    A centre itself would be a blurred light. Every panorama weighs the same, however many of its copies are there: soft
    light passes the rules at all headings, light from one side at a few. At most one light per panorama, or as many
    as it takes when there are fewer panoramas than clusters. Small clusters choose first: they have the fewest
    panoramas to choose from.
    """
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    points = features(lights)
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
    """An order of points (N, D) in which each is the farthest from those before it; starts far from the mean."""
    order = [int(np.linalg.norm(points - points.mean(0), axis=1).argmax())]
    nearest = np.linalg.norm(points - points[order[0]], axis=1)
    for _ in range(len(points) - 1):
        nearest[order[-1]] = -1
        order.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[order[-1]], axis=1))
    return np.array(order)


def split_test(lights: np.ndarray, sources: np.ndarray, settings: Lights) -> np.ndarray:
    """Which lights (N,) are for the test, `settings.test` in `settings.clusters` of them and at least one.

    `random` draws lights; `room` puts all lights of a panorama on one side and takes the panoramas evenly from the
    farthest-first order, so that the test spans the set. A lone panorama is split by light.
    """
    n = len(lights)
    wanted = settings.test if n >= settings.clusters else max(1, round(n * settings.test / settings.clusters))
    test = np.zeros(n, bool)
    if settings.split == "random" or len(np.unique(sources)) == 1:
        test[np.random.default_rng(settings.seed).permutation(n)[:wanted]] = True
        return test
    _, first = np.unique(sources[farthest_first(features(lights))], return_index=True)
    rooms = sources[farthest_first(features(lights))][np.sort(first)]
    stride = len(rooms) / wanted
    # Every `stride`-th room first, then the others, until there are enough lights; one room always stays.
    even = list(dict.fromkeys(int((i + 0.5) * stride) for i in range(wanted) if (i + 0.5) * stride < len(rooms)))
    queue = even + [i for i in range(len(rooms)) if i not in even]
    for i in queue[: len(rooms) - 1]:
        if test.sum() >= wanted:
            break
        test |= sources == rooms[i]
    return test
