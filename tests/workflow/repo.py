"""A copy of this repository in which a test runs the workflow, and what it finds there."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path

import psutil

from relight.core.processes import end_with_parent
from relight.settings import ROOT

LEFT = "results build .snakemake .venv .git mlflow.db mlruns .mlflow.lock __pycache__ docs tests".split()
# Two trainings of which one goes on from the other.
WORDS = ("scale=smoke", "experiment=self_supervised", "figures.count=3", "sweep.only=[ours_full,self_all]")
OUT = "results/smoke"


def copy(folder: Path) -> Path:
    """The repository's files, without results, in `folder`/repo."""
    target = folder / "repo"
    shutil.copytree(ROOT, target, ignore=shutil.ignore_patterns(*LEFT))
    return target


def start(repo: Path, command: list[str], variables: dict[str, str] | None = None, **options) -> subprocess.Popen:
    """A program in a repository, whose package Python finds before the installed one.

    It ends with this process, however that ends: a test that is killed leaves no workflow behind.
    """
    paths = [str(repo), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, **(variables or {}), "PYTHONPATH": os.pathsep.join(paths)}
    begin = partial(end_with_parent, os.getpid())
    return subprocess.Popen(command, cwd=repo, env=environment, stdin=subprocess.DEVNULL, preexec_fn=begin, **options)


def output(repo: Path, command: list[str]) -> subprocess.CompletedProcess:
    """What a program in a repository prints; output and errors as one text in .stdout."""
    process = start(repo, command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    told, _ = process.communicate()
    return subprocess.CompletedProcess(command, process.returncode, told)


def relight(repo: Path, *words: str) -> subprocess.CompletedProcess:
    return output(repo, [sys.executable, "-m", "relight.cli", *words])


# Dry runs of Snakemake itself; they fork from one process, which has imported Snakemake.
DRY_RUNS = """
import importlib, json, os, sys
from pathlib import Path
import relight.lab.plan
from snakemake.cli import main
runs = json.loads(sys.argv[1])
for words, edit in runs:
    if edit:
        file, text = Path(edit[0]), edit[1]
        whole, begin = file.read_text(), "    params:\\n"
        file.write_text(whole.replace(begin, begin + text) if file.suffix == ".smk" else whole + text)
    if os.fork() == 0:
        for name in [name for name in sys.modules if edit and name.startswith("relight")]:
            del sys.modules[name]  # imported before the edit
        sys.argv[1:] = ["all", "-n", "--quiet", "rules", "--config", "hydra=" + " ".join(words)]
        main()
    if os.wait()[1]:
        sys.exit(1)
    if edit:
        file.write_text(whole)
    print("END", flush=True)
"""


def planned(repo: Path, *runs: Sequence[str], edits: Sequence[tuple[str, str] | None] = ()) -> list[dict[str, int]]:
    """What dry runs would do, by their words: {rule: jobs} of each; `edits` of a file are there during one of them."""
    run = output(repo, [sys.executable, "-c", DRY_RUNS, json.dumps([*zip_longest(runs, edits)])])
    assert run.returncode == 0, run.stdout
    tables = [re.findall(r"^(\w+) +(\d+)$", text, re.M) for text in run.stdout.split("END\n")[:-1]]
    return [{rule: int(jobs) for rule, jobs in table if rule not in ("total", "all")} for table in tables]


def outputs(repo: Path) -> list[Path]:
    """The results that the settings decide: logs and pages tell when they were made."""
    out = repo / OUT
    found = [path.relative_to(out) for path in out.rglob("*") if path.is_file() and path.suffix != ".html"]
    apart = ("log", "made", "lock", "run.yaml")
    return sorted(path for path in found if path.parts[0] not in apart and path.name != ".snakemake_timestamp")


def hashes(repo: Path) -> dict[str, str]:
    return {str(path): hashlib.sha256((repo / OUT / path).read_bytes()).hexdigest() for path in outputs(repo)}


def at_work(repo: Path) -> list[psutil.Process]:
    """The processes that work in a repository."""
    found = [process for process in psutil.process_iter(["cwd", "status"]) if process.info["cwd"] == str(repo)]
    return [process for process in found if process.info["status"] != psutil.STATUS_ZOMBIE]


def check_mlflow(repo: Path) -> None:
    """Each training of WORDS has one run that ended well, with each metric once a step, below that of the report."""
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{repo / 'mlflow.db'}")
    found = client.search_runs([client.get_experiment_by_name("smoke").experiment_id])
    report, *runs = sorted(found, key=lambda run: run.info.run_name != "report of smoke")
    assert sorted(run.info.run_name for run in runs) == ["ours_full.s0", "self_all.s0"]
    artifacts = {path.path for path in client.list_artifacts(report.info.run_id)}
    assert artifacts == {"report.html", "run.yaml", "self_supervised.csv"}
    for run in runs:
        name = run.info.run_name
        assert run.info.status == "FINISHED" and run.data.tags["mlflow.parentRunId"] == report.info.run_id
        assert "figures.count=3" in run.data.tags["settings"] and run.data.params["train.steps"] == "24"
        assert "test_shading_rmse" in run.data.metrics and "loss/validation" in run.data.metrics
        steps = {key: [m.step for m in client.get_metric_history(run.info.run_id, key)] for key in run.data.metrics}
        assert steps["loss/train"] == [8, 16, 24]
        assert all(len({*found}) == len(found) for found in steps.values()), f"{name}: logged twice in one step"
        artifacts = {path.name for path in (repo / "mlruns" / run.info.run_id / "artifacts").iterdir()}
        assert artifacts == {"curve", "images", "scores"}
        (data,) = (given.dataset for given in run.inputs.dataset_inputs)
        packed = (repo / OUT / "packed.safetensors").read_bytes()
        assert (data.name, data.digest) == ("smoke", hashlib.sha256(packed).hexdigest()[:36])
    models = client.search_logged_models([report.info.experiment_id])
    assert sorted(model.source_run_id for model in models) == sorted(run.info.run_id for run in runs)
    assert {(model.name, str(model.status)) for model in models} == {("network", "READY")}
    assert not [*(repo / OUT / "train" / "state").glob("*")], "no training is under way"
