"""Which figure is seen under which light at which step: a function of the seed and the step, so nothing to save."""

from functools import lru_cache

import numpy as np


def pairs(seed: int, step: int, batch: int, figures: int, lights: int, order: str = "shuffled") -> np.ndarray:
    """(batch, 2) int64 indices (figure, light) of `step`; each pass over the data shows every pair exactly once.

    `shuffled` draws all pairs of a pass in random order; `rows` draws the figures in random order and gives each its
    lights in a row, as the authors do. A batch may reach over the end of a pass into the next.
    """
    number, place = np.divmod(step * batch + np.arange(batch), figures * lights)
    chosen = np.array([one_pass(seed, int(n), figures, lights, order)[p] for n, p in zip(number, place)])
    return np.stack([chosen // lights, chosen % lights], 1)


@lru_cache(maxsize=4)
def one_pass(seed: int, number: int, figures: int, lights: int, order: str) -> np.ndarray:
    """The order (figures * lights,) of the pairs figure * lights + light in pass `number`."""
    rng = generator(seed, number)
    if order == "shuffled":
        return rng.permutation(figures * lights)
    rows = rng.permutation(figures)[:, None] * lights
    return (rows + rng.permuted(np.tile(np.arange(lights), (figures, 1)), axis=1)).ravel()


def generator(seed: int, counter: int, purpose: int = 0) -> np.random.Generator:
    """The random numbers that belong to (seed, counter, purpose) and to nothing else."""
    return np.random.Generator(np.random.Philox(key=[seed, (purpose << 48) + counter]))
