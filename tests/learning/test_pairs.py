"""The order of the training pairs."""

import pytest

from relight.learning.data import draw_pairs


def taken(order: str, batch: int, steps: int, seed: int = 3) -> list[tuple[int, int]]:
    return [tuple(pair) for step in range(steps) for pair in draw_pairs(seed, step, batch, 5, 7, order).tolist()]


@pytest.mark.parametrize("order", ["shuffled", "rows"])
@pytest.mark.parametrize("batch", [1, 4, 50])
def test_each_pass_shows_every_pair_once(order, batch):
    found = taken(order, batch, 105 // batch + 1)
    for first in (0, 35, 70):
        if first + 35 <= len(found):
            assert len(set(found[first : first + 35])) == 35
    assert found[:35] != found[35:70]


def test_the_order_depends_on_the_seed_and_not_on_the_batch_and_rows_are_of_one_figure():
    assert taken("shuffled", 1, 40) == taken("shuffled", 4, 10)
    assert taken("shuffled", 4, 10) != taken("shuffled", 4, 10, seed=4)
    figures = [figure for figure, _ in taken("rows", 5, 7)]
    assert all(len(set(figures[i : i + 7])) == 1 for i in range(0, 35, 7))
