"""Training and test figures."""

import numpy as np
import pytest

from relight.config import Split
from relight.files import UserError
from relight.learning.split import deal

NAMES = [f"f{i:02d}" for i in range(40)]
SUBJECTS = [f"s{i // 4}" for i in range(40)]


def split(kind, test=0.25, seed=0):
    return Split(kind=kind, test=test, seed=seed, least=0.5)


@pytest.mark.parametrize("kind", ["subject", "paper"])
def test_every_figure_once(kind):
    parts = deal(NAMES, SUBJECTS, split(kind))
    assert sorted(parts["train"] + parts["test"]) == NAMES
    assert len(parts["test"]) == pytest.approx(10, abs=2)


def test_subjects_stay_on_one_side():
    subject = dict(zip(NAMES, SUBJECTS))
    for seed in range(10):
        parts = deal(NAMES, SUBJECTS, split("subject", seed=seed))
        assert not {subject[name] for name in parts["train"]} & {subject[name] for name in parts["test"]}
    leaks = [deal(NAMES, SUBJECTS, split("paper", seed=seed)) for seed in range(10)]
    assert any({subject[n] for n in part["train"]} & {subject[n] for n in part["test"]} for part in leaks)


def test_both_sides_hold_a_figure():
    for test in np.linspace(0.01, 0.99, 9):
        for count in (2, 3, 5):
            parts = deal(NAMES[:count], NAMES[:count], split("subject", float(test)))
            assert parts["train"] and parts["test"]


def test_too_few_subjects():
    with pytest.raises(UserError, match="two subjects"):
        deal(NAMES[:3], SUBJECTS[:3], split("subject"))
    assert deal(NAMES[:3], SUBJECTS[:3], split("paper"))["test"]
