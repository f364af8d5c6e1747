"""Scripts of `benchmarks/` and `tools/`: they import, and a step of the training that they time runs."""

import importlib
import sys
from pathlib import Path

import pytest

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
    from relight.settings import Model

    training = importlib.import_module("training")
    model = Model("ours", 0.125, "batch", 0.5, 2, "clip", "strided", False, "image")
    case = training.Case(model, 64, 2, "f32", "cpu", False, tmp_path)
    before = [weight.detach().clone() for weight in case.network.parameters()]
    case.step()
    assert any((one != other).any() for one, other in zip(before, case.network.parameters()))


def test_every_optimizer_is_timed(scripts):
    training = importlib.import_module("training")
    times = training.optimizer_times(training.Clock("cpu", 1, 0), 0.0625, "cpu")
    assert len(times) == 3 and all(seconds > 0 for seconds in times.values())


@pytest.mark.parametrize(
    ("words", "size", "operations"),
    [
        (["scale=paper"], 1024, 328e9),  # the paper's network
        *((["scale=smoke", *more], 64, None) for more in (["model=ours_plus"], ["model=unet"])),
    ],
)
@pytest.mark.slow
def test_multiply_adds_of_every_network(scripts, words, size, operations):
    """Heads that leave autocast, too: fake tensors have a device, meta tensors have one that autocast refuses."""
    from omegaconf import OmegaConf

    from relight.settings import composed

    counted = 2 * importlib.import_module("training").multiply_adds(OmegaConf.to_object(composed(words)).model, size)
    assert counted == pytest.approx(operations, rel=0.01) if operations else counted > 2e6


def test_transport_without_its_extra_says_what_to_install(scripts, monkeypatch, capsys):
    transport = importlib.import_module("transport")
    monkeypatch.setattr(sys, "argv", ["transport.py"])
    monkeypatch.setitem(sys.modules, "trimesh.ray.ray_pyembree", None)  # as if embreex were not installed
    with pytest.raises(SystemExit):
        transport.main()
    assert "embreex, which the extra `bench` installs" in capsys.readouterr().err
