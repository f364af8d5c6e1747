"""Collects the provenance of a report: date, code, machine, cost, and the command that repeats the run."""

import platform
import shlex
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
import yaml

from relight.core.processes import count_cores, git
from relight.core.version import __version__
from relight.settings import ROOT


def provenance(folder: Path) -> dict[str, Any]:
    """Collects the provenance of the report of results/<name>, whose run.yaml contains the given settings.

    Returns:
        `date`; `version` of relight; `commit`, "" without git; whether files are `changed` since; `machine`, in words;
        the `command` that repeats the run from a clone.
    """
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "version": __version__,
        "commit": git(ROOT, "rev-parse", "HEAD")[:12],
        "changed": bool(git(ROOT, "status", "--porcelain", "--untracked-files=no")),
        "machine": machine(),
        "command": command(folder),
    }


def machine() -> str:
    """Describes processor, cores, memory, GPU and system, without the host name."""
    import torch

    cores = count_cores()
    parts = [f"{processor()}, {cores} core{'s' * (cores != 1)}", f"{psutil.virtual_memory().total / 2**30:.0f} GiB"]
    parts += [torch.cuda.get_device_name(0)] if torch.cuda.is_available() else []
    return "; ".join([*parts, f"{platform.system()} {platform.machine()}", f"Python {platform.python_version()}"])


def processor() -> str:
    """Returns the model name of the processor: that of Linux, or else Python's."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def command(folder: Path) -> str:
    """Returns the command that repeats results/<name> in a clone; a sweep is repeated from its record, run.yaml."""
    record = folder / "run.yaml"
    config = yaml.safe_load(record.read_text()) if record.exists() else {}
    if list(config.get("settings", {}).get("experiments", ())) == ["sweep"]:
        return f"snakemake all --configfile results/{folder.name}/run.yaml"
    return shlex.join(["relight", "run", *config.get("overrides", [])])


def costs(folder: Path) -> tuple[pd.DataFrame, float]:
    """Sums Snakemake's measurements of jobs by stage, of the results in a folder.

    For jobs of a few seconds, Snakemake's samples miss a part of the CPU time and of the memory.

    Returns:
        A row per stage: number of jobs, mean and sum of their seconds, CPU seconds, and the largest memory in GB. And
        the seconds during which at least one of the jobs ran, without pauses between interrupted runs.
    """
    lines, times = [], []
    top = folder / "benchmark"
    for path in sorted(top.rglob("*.tsv")):
        jobs = pd.read_csv(path, sep="\t", na_values=["-", "NA"])
        seconds, end = float(jobs["s"].sum()), path.stat().st_mtime  # Snakemake writes the file when a job ends
        times.append((end - seconds, end))
        cpu = float(jobs["cpu_time"].sum()) if "cpu_time" in jobs else float("nan")
        stage, memory = path.relative_to(top).parts[0], jobs["max_rss"].max() / 1024  # GB of MB
        lines.append([stage, seconds, cpu, memory])
    frame = pd.DataFrame(lines, columns=["stage", "seconds", "cpu", "memory"])
    by_stage = frame.groupby("stage").agg(
        jobs=("seconds", "size"),
        mean=("seconds", "mean"),
        seconds=("seconds", "sum"),
        cpu=("cpu", "sum"),
        memory=("memory", "max"),
    )
    wall, end_so_far = 0.0, float("-inf")
    for begin, end in sorted(times):
        wall += max(0.0, end - max(begin, end_so_far))  # only what no earlier job covers
        end_so_far = max(end_so_far, end)
    return by_stage, wall
