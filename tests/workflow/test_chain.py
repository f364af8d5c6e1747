"""The whole workflow at its smallest, from seeds to the report; what re-runs; and what a kill leaves."""

import csv
import hashlib
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from repo import copy, environment, planned, relight

WORDS = ("scale=smoke", "figures.count=4", "sweep.only=[ours_full,sfsnet_ao,no_tv]")
OUT = "results/smoke"
KILLS = int(os.environ.get("RELIGHT_CHAOS", "4"))  # `make chaos` takes 60
KINDS = ("group", "SIGKILL", "job", "SIGTERM", "snakemake", "SIGINT", "SIGHUP")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    """A repository in which the workflow ran through, undisturbed."""
    repo = copy(tmp_path_factory.mktemp("chain"))
    run = relight(repo, "run", *WORDS)
    assert run.returncode == 0, run.stdout
    return repo


def test_tables_hold_numbers(done):
    for name, rows in (("table1", {"ours_full", "sfsnet_ao"}), ("table2", {"ours_full", "no_tv"})):
        with open(done / OUT / "report" / f"{name}.csv", newline="") as file:
            table = list(csv.DictReader(file))
        found = {row["row"] for row in table}
        assert rows <= found
        for row in table:
            if row["row"] in rows:
                assert math.isfinite(float(row["shading_rmse"])) and float(row["shading_rmse"]) > 0
        for suffix in (".md", ".tex"):
            assert (done / OUT / "report" / (name + suffix)).stat().st_size > 500


def test_report_is_one_page_with_pictures(done):
    page = (done / OUT / "report" / "report.html").read_text()
    assert page.count("data:image/") >= 5
    assert 'href="viewer.html"' in page and (done / OUT / "report" / "viewer.html").stat().st_size > 50_000
    assert "http://" not in page.replace("http://www.w3.org", "") and "<script src" not in page


def test_maps_open_with_named_layers(done):
    import OpenEXR

    with OpenEXR.File(str(done / OUT / "maps" / "g0000.exr"), separate_channels=True) as file:
        channels = set(file.channels())
    assert {"albedo.R", "normal.X", "mask.A", "ao.Y", "depth.Z", "transport.L0M0.Y"} <= channels


def check_mlflow(repo):
    """Each training has one run that ended well, with its losses once."""
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{repo / 'mlflow.db'}")
    runs = client.search_runs([client.get_experiment_by_name("smoke").experiment_id])
    (above,) = (run for run in runs if "mlflow.parentRunId" not in run.data.tags)
    runs.remove(above)
    assert above.info.run_name == "smoke" and above.info.status == "FINISHED"
    assert above.data.params["figures.count"] == "4" and above.data.tags["best"] in {run.info.run_name for run in runs}
    report = {path.name for path in (repo / above.info.artifact_uri / "report").iterdir()}
    assert {"report.html", "table1.csv", "table1_plates.png"} <= report
    assert sorted(run.info.run_name for run in runs) == ["no_tv.s0", "ours_full.s0", "sfsnet_ao.s0"]
    for run in runs:
        name = run.info.run_name
        assert run.info.status == "FINISHED"
        assert run.data.params["train.steps"] == "24" and "test/shading_rmse" in run.data.metrics
        assert [point.step for point in client.get_metric_history(run.info.run_id, "loss")] == [8, 16, 24]
        artifacts = {path.name for path in (repo / run.info.artifact_uri).iterdir()}
        assert {"config.yaml", f"{name}.csv", "images"} <= artifacts and run.outputs.model_outputs
        assert run.data.tags["mlflow.parentRunId"] == above.info.run_id
    assert not (repo / OUT / "train" / "state").exists(), "no training is under way"


def test_runs_are_in_mlflow(done):
    check_mlflow(done)


def test_a_second_run_does_nothing(done):
    run = relight(done, "run", *WORDS)
    assert run.returncode == 0 and "Nothing to be done" in run.stdout


AFTER_TRAINING = {"evaluate": 3, "tables": 1, "plates": 1, "report": 1}
AFTER_BAKING = {"pack": 1, "split": 1, "train": 3, "baselines": 1, "sheets": 1, "viewer": 1, **AFTER_TRAINING}


@pytest.mark.parametrize(
    ("override", "jobs"),
    [
        ("train.lr=0.5", {"train": 3, **AFTER_TRAINING}),
        ("bake.rays=8", {"bake": 4, **AFTER_BAKING}),
        ("bake.views=2", {"bake": 4, **AFTER_BAKING}),
        ("align.padding=0.1", {"align": 4, "clean": 4, "bake": 4, **AFTER_BAKING}),
        ("lights.clusters=5", {"lights": 1, "train": 3, "baselines": 1, "sheets": 1, "viewer": 1, **AFTER_TRAINING}),
        ("evaluate.bootstrap=99 track=none", {"tables": 1, "report": 1}),
        ("evaluate.plates=3 evaluate.sheet=3", {"plates": 1, "sheets": 1, "report": 1}),
    ],
)
def test_a_change_runs_what_it_touches(done, override, jobs):
    assert planned(done, *WORDS, *override.split()) == jobs


def test_another_experiment_takes_what_is_there(done, tmp_path):
    """Other lights, and a training that goes on from one that is there: only what is new is made."""
    repo = tmp_path / "repo"
    shutil.copytree(done, repo)
    words = ("scale=smoke", "figures.count=4", "experiment=[unusual_lights,self_supervised]")
    words += ("sweep.only=[ours_full,self_all]",)
    new = {"train": 1, "evaluate": 2, "baselines": 1, "tables": 1, "plates": 2, "report": 1}
    assert planned(repo, *words) == new
    run = relight(repo, "run", *words)
    assert run.returncode == 0, run.stdout
    page = (repo / OUT / "report" / "report.html").read_text()
    assert 'id="self_supervised"' in page and 'id="unusual_lights"' in page and 'class="failed"' not in page
    with open(repo / OUT / "report" / "unusual_lights.csv", newline="") as file:
        assert "ours_full" in {row["row"] for row in csv.DictReader(file)}
    assert (repo / OUT / "evaluate" / "test-unusual" / "ours_full.s0.csv").stat().st_size > 500


def test_a_run_by_snakemake_alone_is_the_same_run(done):
    assert planned(done, *WORDS) == {}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("train.lrr=1",), "train.lrr: no such setting"),
        (("train.lr=fast",), "train.lr: 'fast' is not of type Float"),
        (("figures=scans", "figures.folder=/nowhere/at/all"), "no folder /nowhere/at/all"),
        (("panoramas=folder", "panoramas.folder=/nowhere/at/all"), "/nowhere/at/all"),
    ],
)
def test_errors_are_one_line(done, words, told):
    run = relight(done, "run", "scale=smoke", *words)
    lines = run.stdout.strip().splitlines()
    assert run.returncode == 1 and len(lines) == 1 and told in lines[0], run.stdout


def outputs(repo: Path) -> list[Path]:
    """The results that the settings decide: logs, benchmarks and pages tell when and how long they were made."""
    out = repo / OUT
    found = [path.relative_to(out) for path in out.rglob("*") if path.is_file()]
    return sorted(path for path in found if path.suffix != ".html" and path.parts[0] not in ("log", "benchmark"))


def hashes(repo: Path) -> dict[str, str]:
    return {str(path): hashlib.sha256((repo / OUT / path).read_bytes()).hexdigest() for path in outputs(repo)}


def at_work(repo: Path) -> list[psutil.Process]:
    """The processes that work in a repository."""
    found = []
    for process in psutil.process_iter(["cwd", "status"]):
        if process.info["cwd"] == str(repo) and process.info["status"] != psutil.STATUS_ZOMBIE:
            found.append(process)
    return found


def running(repo: Path, *words: str) -> list[psutil.Process]:
    """Those of its processes whose command line holds all of these words."""
    found = []
    for process in at_work(repo):
        with suppress(psutil.NoSuchProcess):
            line = " ".join(process.cmdline())
            if all(word in line for word in words):
                found.append(process)
    return found


def kill(kind: str, command: subprocess.Popen, repo: Path) -> None:
    """Ends a part of the workflow: all of it, Snakemake, one of its jobs, or the command by a signal."""
    match kind:
        case "group":
            os.killpg(command.pid, signal.SIGKILL)
        case "snakemake" | "job":
            flows = running(repo, "-m snakemake") if kind == "snakemake" else running(repo, "-m relight.stages.")
            for process in flows[:1]:
                with suppress(psutil.NoSuchProcess):
                    process.kill()
        case signame:
            command.send_signal(signal.Signals[signame])


def test_killed_anywhere_it_ends_in_the_same_bytes(done, tmp_path):
    """Killed again and again, each time when some more files are there, on one core and on two, in another folder."""
    repo, rng = copy(tmp_path), random.Random(KILLS)
    wanted = hashes(done)
    command = [sys.executable, "-m", "relight.cli", "run", *WORDS]
    for count in range(KILLS):
        job = subprocess.Popen(
            [*command, "--cores", str(1 + count % 2)],
            cwd=repo,
            env=environment(repo),
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        # The moment is one of progress, so that a slow machine is killed in all stages, too.
        left = len(wanted) - len(outputs(repo))
        goal = len(wanted) - left + rng.randint(0, max(1, 2 * left // (KILLS - count)))
        while len(outputs(repo)) < goal and job.poll() is None:
            time.sleep(0.2)
        time.sleep(rng.uniform(0, 2))
        kind = KINDS[count % len(KINDS)]
        kill(kind, job, repo)
        if kind == "job":  # Snakemake does what else it can, and fails
            job.send_signal(signal.SIGTERM)
        job.wait()
        _, alive = psutil.wait_procs(at_work(repo), timeout=60)
        assert not alive, f"after {kind}, kill {count + 1}: something works on"
    run = relight(repo, "run", *WORDS)
    assert run.returncode == 0, run.stdout
    assert hashes(repo) == wanted
    assert not [path for path in (repo / OUT).rglob(".*") if path.is_file()], "temporary files were left behind"
    check_mlflow(repo)
