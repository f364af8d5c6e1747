"""Scripts of `benchmarks/` and `tools/`: they import, and a step of the training that they time runs."""

import importlib
import sys
from pathlib import Path

import pytest

from relight.settings import Model

FOLDERS = [Path(__file__).parents[1] / name for name in ("tools", "benchmarks")]


@pytest.fixture
def scripts(monkeypatch):
    """The folders on the path; their modules are forgotten afterwards."""
    for folder in FOLDERS:
        monkeypatch.syspath_prepend(folder)
    names = [path.stem for folder in FOLDERS for path in sorted(folder.glob("*.py"))]
    names.remove("hooks")  # of MkDocs, which the extra `docs` installs
    yield names
    for name in names:
        sys.modules.pop(name, None)


@pytest.mark.slow
def test_every_script_can_be_imported(scripts):
    for name in scripts:
        importlib.import_module(name)


def test_a_step_of_the_timed_training_runs(scripts, tmp_path):
    training = importlib.import_module("training")
    model = Model("ours", 0.125, "batch", 0.5, 2, "clip", "strided", False, "image")
    case = training.Case(model, 64, 2, "f32", "cpu", False, tmp_path)
    before = [weight.detach().clone() for weight in case.network.parameters()]
    case.step()
    assert any((one != other).any() for one, other in zip(before, case.network.parameters()))
