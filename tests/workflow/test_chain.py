"""The whole workflow at its smallest, from seeds to the report, and what re-runs."""

import csv
import math
import shutil

import pytest
from repo import OUT, WORDS, check_mlflow, planned, relight

pytestmark = pytest.mark.slow


def test_tables_hold_numbers(done):
    both = {"ours_full", "self_all"}
    for name, rows in (("table1", {"ours_full"}), ("unusual_lights", {"ours_full"}), ("self_supervised", both)):
        with open(done / OUT / "report" / f"{name}.csv", newline="") as file:
            table = list(csv.DictReader(file))
        found = {row["row"] for row in table}
        assert rows <= found
        for row in table:
            if row["row"] in rows:
                assert math.isfinite(float(row["shading_rmse"])) and float(row["shading_rmse"]) > 0
        assert (done / OUT / "report" / f"{name}.md").stat().st_size > 500


def test_report_is_one_page_with_pictures(done):
    page = (done / OUT / "report" / "report.html").read_text()
    assert page.count("data:image/") >= 5
    assert 'href="viewer.html"' in page and (done / OUT / "report" / "viewer.html").stat().st_size > 50_000
    assert 'id="self_supervised"' in page and 'id="unusual_lights"' in page and 'class="failed"' not in page
    assert "http://" not in page.replace("http://www.w3.org", "") and "<script src" not in page


def test_runs_are_in_mlflow(done):
    check_mlflow(done)


def test_a_second_run_does_nothing(done):
    run = relight(done, "run", *WORDS)
    assert run.returncode == 0 and "Nothing to be done" in run.stdout


AFTER_TRAINING = {"evaluate": 3, "tables": 1, "plates": 3, "report": 1, "viewer": 1}
AFTER_BAKING = {"pack": 1, "split": 1, "train": 2, "baselines": 2, "sheets": 1, **AFTER_TRAINING}
AFTER_LIGHTS = {"train": 2, "baselines": 2, "sheets": 1, **AFTER_TRAINING}
CHANGES = {
    "": {},
    "track.experiment=other": {},
    "train.device=cpu": {"train": 2, **AFTER_TRAINING},
    "train.lr=0.5": {"train": 2, **AFTER_TRAINING},
    "augment.camera=0": {},
    "loss.tv_reference=512": {"train": 2, **AFTER_TRAINING},
    "split.seed=1": {"split": 1, "train": 2, "baselines": 2, **AFTER_TRAINING},
    "bake.rays=8": {"bake": 1, **AFTER_BAKING},
    "bake.views=2": {"bake": 1, **AFTER_BAKING},
    "align.up=+y": {"clean": 1, "align": 1, "bake": 1, **AFTER_BAKING},
    "figures.sitting=0.5": {"figure": 1, "clean": 1, "align": 1, "bake": 1, **AFTER_BAKING},
    "lights.clusters=5": {"lights": 1, **AFTER_LIGHTS},
    "panoramas.count=25": {"lights": 1, **AFTER_LIGHTS},
    # One more network, on the usual figures and lights.
    "experiment=[table1,table2] sweep.only=[ours_full,no_tv]": {"train": 1, "evaluate": 1, "tables": 1, "report": 1},
}


@pytest.fixture(scope="module")
def plans(done):
    """What Snakemake would do after each of CHANGES; it is called alone, without `relight run`."""
    given = {word.partition("=")[0]: word for word in WORDS}
    changed = [{word.partition("=")[0]: word for word in change.split()} for change in CHANGES]
    return dict(zip(CHANGES, planned(done, *([*(given | words).values()] for words in changed))))


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_runs_what_it_touches(plans, change):
    assert plans[change] == CHANGES[change]


@pytest.mark.parametrize(
    ("file", "text", "rules"),
    [
        ("relight/learning/losses.py", "X = 1\n", {"train": 2, **AFTER_TRAINING}),
        ("relight/transport/integrate.py", "# A comment.\n", {}),
        ("workflow/scripts/lights.py", "X = 1\n", {"lights": 1, **AFTER_LIGHTS}),
        ("workflow/rules/lights.smk", "        more=1,\n", {"lights": 1, **AFTER_LIGHTS}),
    ],
)
def test_changed_code_runs_what_it_touches(done, tmp_path, file, text, rules):
    repo = tmp_path / "repo"
    shutil.copytree(done, repo, ignore=shutil.ignore_patterns("mlruns"))
    before = (repo / file).read_text()
    changed = before.replace("    params:\n", f"    params:\n{text}") if file.endswith(".smk") else f"{before}{text}"
    (repo / file).write_text(changed)
    assert planned(repo, WORDS)[0] == rules


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("train.lrr=1",), "train.lrr: no such setting"),
        (("train.lr=fast",), "train.lr must be a number, not 'fast'"),
        (("figures=scans", "figures.folder=/nowhere/at/all"), "no folder /nowhere/at/all"),
        (("panoramas=folder", "panoramas.folder=/nowhere/at/all"), "/nowhere/at/all"),
    ],
)
def test_errors_are_one_line(done, words, told):
    run = relight(done, "run", "scale=smoke", *words)
    lines = run.stdout.strip().splitlines()
    assert run.returncode == 1 and len(lines) == 1 and told in lines[0], run.stdout
