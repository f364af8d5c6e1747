"""A copy of this repository in which a test runs the workflow."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from relight.config import ROOT

LEFT = ("results", ".snakemake", ".venv", ".git", "mlflow.db", "mlruns", ".mlflow.lock", "__pycache__", "docs", "tests")


def copy(folder: Path) -> Path:
    """The repository's files, without results, in `folder`/repo."""
    target = folder / "repo"
    shutil.copytree(ROOT, target, ignore=shutil.ignore_patterns(*LEFT))
    return target


def environment(repo: Path) -> dict[str, str]:
    """Python finds the copy's package before the installed one."""
    return {**os.environ, "PYTHONPATH": str(repo)}


def relight(repo: Path, *words: str) -> subprocess.CompletedProcess:
    """`relight words...` in the copy; output and errors as one text in .stdout."""
    command = [sys.executable, "-m", "relight.cli", *words]
    return subprocess.run(
        command,
        cwd=repo,
        env=environment(repo),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
    )


def planned(repo: Path, *words: str) -> dict[str, int]:
    """What a dry run would do: {rule: jobs}, without the writing of settings and lists.

    It is Snakemake's own, which is half of the work of `relight run --dry-run`.
    """
    command = [sys.executable, "-m", "snakemake", "all", "-n", "--config", "hydra=" + " ".join(words)]
    run = subprocess.run(command, cwd=repo, env=environment(repo), text=True, capture_output=True)
    assert run.returncode == 0, run.stderr
    table = re.findall(r"^(\w+) +(\d+)$", run.stdout + run.stderr, re.M)
    passed = ("total", "all", "settings", "listing", "experiments")
    return {rule: int(jobs) for rule, jobs in table if rule not in passed}
