"""Training and test figures."""

import numpy as np

from relight.config import Split
from relight.files import UserError


def deal(names: list[str], subjects: list[str], split: Split) -> dict[str, list[str]]:
    """{"train": names, "test": names}, each in the order of `names`; both sides hold at least one figure.

    `subject` draws whole subjects for the test side until it holds the asked share, so no person is on both sides;
    `paper` draws figures at random (section 5 of the paper). Raises UserError when there are fewer than two units.
    """
    units = subjects if split.kind == "subject" else names
    order = sorted(set(units))
    if len(order) < 2:
        what = "subjects" if split.kind == "subject" else "figures"
        raise UserError(f"split: at least two {what} are needed, one to train on and one to test on, not {len(order)}")
    np.random.default_rng(split.seed).shuffle(order)
    wanted = split.test * len(names)
    test, count = set(), 0
    for unit in order[:-1]:
        size = units.count(unit)
        if test and count + size / 2 > wanted:
            break
        test.add(unit)
        count += size
    return {
        "train": [name for name, unit in zip(names, units) if unit not in test],
        "test": [name for name, unit in zip(names, units) if unit in test],
    }
