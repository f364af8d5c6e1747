"""The plan that the Snakefile asks: figures, runs, settings of each stage."""

import pytest
import yaml

from relight.files import UserError
from relight.run import swept
from relight.workflow import Plan


def test_overrides_as_words_or_list():
    for hydra in ("scale=smoke figures.count=3", ["scale=smoke", "figures.count=3"]):
        assert Plan({"hydra": hydra}).figures == ["g0000", "g0001", "g0002"]
    assert Plan({"hydra": None}).out == "results/demo"


def test_runs_are_rows_times_seeds():
    plan = Plan({"hydra": "scale=smoke sweep.seeds=[0,7]"})
    assert len(plan.runs) == 2 * len(plan.rows) and len(plan.rows) >= 7
    settings = yaml.safe_load(plan.settings("train.no_tv.s7"))
    assert settings["train"]["seed"] == 7 and settings["loss"]["tv_albedo"] == 0


def test_a_stage_gets_what_it_reads_and_nothing_else():
    settings = yaml.safe_load(Plan({"hydra": "scale=smoke"}).settings("bake"))
    assert set(settings) == {"defaults", "hydra", "bake"}


def test_sweep_is_the_product():
    fixed, runs = swept(["scale=smoke", "train.lr=1e-4,2e-4", "loss=min,full"])
    assert fixed == ["scale=smoke"]
    assert runs == {
        "lr_0.0001-loss_min": ["train.lr=0.0001", "loss=min"],
        "lr_0.0001-loss_full": ["train.lr=0.0001", "loss=full"],
        "lr_0.0002-loss_min": ["train.lr=0.0002", "loss=min"],
        "lr_0.0002-loss_full": ["train.lr=0.0002", "loss=full"],
    }


def test_sweep_needs_a_list():
    with pytest.raises(UserError, match="-m sweeps over lists"):
        swept(["loss=min"])


@pytest.mark.parametrize("folder", ["missing", "empty"])
def test_folders_of_scans_are_checked(tmp_path, folder):
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match=folder) as error:
        _ = Plan({"hydra": ["figures=scans", f"figures.folder={tmp_path / folder}"]}).figures
    assert "\n" not in str(error.value) and (folder == "missing" or ".obj" in str(error.value))
