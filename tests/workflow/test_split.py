"""Training, validation and test figures."""

from dataclasses import replace

import numpy as np
import pytest

from relight.core.errors import UserError
from relight.learning.split import is_seated, split_figures
from relight.settings import Split

NAMES = [f"f{i:02d}" for i in range(40)]
SUBJECTS = [f"s{i // 4}" for i in range(40)]


def split(kind, test=0.25, seed=0):
    return Split(kind=kind, test=test, seed=seed, least=0.5)


@pytest.mark.parametrize("kind", ["subject", "paper"])
def test_every_figure_once(kind):
    parts = split_figures(NAMES, SUBJECTS, split(kind))
    assert sorted(parts["train"] + parts["validation"] + parts["test"]) == NAMES
    assert len(parts["test"]) == pytest.approx(10, abs=2) and 3 <= len(parts["validation"]) <= 4


def test_subjects_stay_on_one_side():
    subject = dict(zip(NAMES, SUBJECTS))
    for seed in range(10):
        parts = split_figures(NAMES, SUBJECTS, split("subject", seed=seed))
        train, validation, test = ({subject[name] for name in parts[part]} for part in ("train", "validation", "test"))
        assert not train & test and not train & validation and not validation & test and validation
    leaks = [split_figures(NAMES, SUBJECTS, split("paper", seed=seed)) for seed in range(10)]
    assert any({subject[n] for n in part["train"]} & {subject[n] for n in part["test"]} for part in leaks)


def test_both_sides_hold_a_figure():
    for test in np.linspace(0.01, 0.99, 9):
        for count in (2, 3, 5):
            parts = split_figures(NAMES[:count], NAMES[:count], split("subject", float(test)))
            assert parts["train"] and parts["test"]
            assert len(parts["validation"]) == (len(parts["train"] + parts["validation"]) > 1)


def test_the_validation_has_few_figures_and_changes_no_test(monkeypatch):
    names = [f"f{i:03d}" for i in range(345)]
    parts = split_figures(names, names, split("subject"))
    assert len(parts["validation"]) == 8 and len(parts["train"]) == 345 - 8 - len(parts["test"])
    assert set(parts["validation"]) != set(split_figures(names, names, split("subject", seed=1))["validation"])
    monkeypatch.setattr("relight.learning.split.MAX_VALIDATION", 20)
    larger = split_figures(names, names, split("subject"))
    assert len(larger["validation"]) == 20 and larger["test"] == parts["test"]


@pytest.mark.parametrize(("sizes", "test"), [((30, 30, 4), 4), ((15,) * 5, 15), ((30,) * 3, 30)])
def test_few_people_of_many_figures_are_mostly_for_training(sizes, test):
    """Neither test nor validation takes a person of half of the set where less was asked for."""
    subjects = [f"s{i}" for i, size in enumerate(sizes) for _ in range(size)]
    names = [f"f{i:02d}" for i in range(len(subjects))]
    for seed in range(4):
        parts = split_figures(names, subjects, split("subject", test=0.2, seed=seed))
        assert (len(parts["test"]), len(parts["validation"])) == (test, round(0.1 * (len(names) - test)))


def test_too_few_subjects():
    with pytest.raises(UserError, match="two subjects"):
        split_figures(NAMES[:3], SUBJECTS[:3], split("subject"))
    assert split_figures(NAMES[:3], SUBJECTS[:3], split("paper"))["test"]


def test_sitting_figures_are_set_apart_or_dealt():
    assert is_seated({"pose": "sitting wide"}) and not is_seated({"pose": "walking"}) and not is_seated({})
    assert is_seated({"sitting": True}) and not is_seated({"pose": "sitting", "sitting": False})
    sitting = set(NAMES[::7])
    for kind in ("subject", "paper"):
        parts = split_figures(NAMES, SUBJECTS, split(kind), sitting)
        assert parts["sitting"] == [name for name in NAMES if name in sitting]
        assert not sitting & {*parts["train"], *parts["test"]}
        dealt = replace(split(kind), sitting="dealt")
        assert split_figures(NAMES, SUBJECTS, dealt, sitting) == split_figures(NAMES, SUBJECTS, split(kind))
