"""A copy of this repository in which a test runs the workflow, and what it finds there."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from functools import partial
from pathlib import Path

import psutil

from relight.config import ROOT
from relight.processes import end_with_parent

LEFT = (
    "results",
    "build",
    ".snakemake",
    ".venv",
    ".git",
    "mlflow.db",
    "mlruns",
    ".mlflow.lock",
    "__pycache__",
    "docs",
    "tests",
)
WORDS = ("scale=smoke", "experiment=[table1,table2]", "figures.count=3", "sweep.only=[ours_full,sfsnet_ao,no_tv]")
OUT = "results/smoke"


def copy(folder: Path) -> Path:
    """The repository's files, without results, in `folder`/repo."""
    target = folder / "repo"
    shutil.copytree(ROOT, target, ignore=shutil.ignore_patterns(*LEFT))
    return target


def start(repo: Path, command: list[str], variables: dict[str, str] | None = None, **options) -> subprocess.Popen:
    """A program in a repository, whose package Python finds before the installed one.

    It ends with this process, however that ends: a test that is killed leaves no workflow behind.

    Args:
        repo: see `copy`.
        command: its words.
        variables: more of its environment.
        options: of `subprocess.Popen`.
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
    """`relight words...` in the copy."""
    return output(repo, [sys.executable, "-m", "relight.cli", *words])


def planned(repo: Path, *words: str) -> dict[str, int]:
    """What a dry run would do: {rule: jobs}, without the writing of settings and lists.

    It is Snakemake's own, which is half of the work of `relight run --dry-run`.
    """
    run = output(repo, [sys.executable, "-m", "snakemake", "all", "-n", "--config", "hydra=" + " ".join(words)])
    assert run.returncode == 0, run.stdout
    table = re.findall(r"^(\w+) +(\d+)$", run.stdout, re.M)
    passed = ("total", "all", "settings")
    return {rule: int(jobs) for rule, jobs in table if rule not in passed}


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
    for process in psutil.process_iter(["cwd", "status", "cmdline"]):
        if process.info["cwd"] == str(repo) and process.info["status"] != psutil.STATUS_ZOMBIE:
            found.append(process)
    return found


def check_mlflow(repo: Path) -> None:
    """Each training of WORDS has one run that ended well, with each of its metrics once a step."""
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{repo / 'mlflow.db'}")
    runs = client.search_runs([client.get_experiment_by_name("smoke").experiment_id])
    assert sorted(run.info.run_name for run in runs) == ["no_tv.s0", "ours_full.s0", "sfsnet_ao.s0"]
    for run in runs:
        name = run.info.run_name
        assert run.info.status == "FINISHED"
        assert "figures.count=3" in run.data.tags["settings"] and run.data.params["train.steps"] == "24"
        assert "test_shading_rmse" in run.data.metrics and "loss/validation" in run.data.metrics
        steps = {key: [m.step for m in client.get_metric_history(run.info.run_id, key)] for key in run.data.metrics}
        assert steps["loss/train"] == [8, 16, 24]
        again = {key: found for key, found in steps.items() if max(Counter(found).values()) > 1}
        assert not again, f"{name}: logged twice in one step"
        artifacts = {path.name for path in (repo / "mlruns" / run.info.run_id / "artifacts").iterdir()}
        assert artifacts == {"curve", "images", "scores"} and run.outputs.model_outputs
    version = client.get_model_version_by_alias("relight", "paper")
    assert client.get_run(version.run_id).info.run_name == "ours_full.s0"
    assert not (repo / OUT / "train" / "state").exists(), "no training is under way"
