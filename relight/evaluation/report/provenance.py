"""Collects the provenance of a report: date, code, machine, and the command that repeats the run."""

import platform
import shlex
from datetime import UTC, datetime
from typing import Any

import psutil

from relight.core.processes import count_cores, git
from relight.core.text import without_passwords
from relight.core.version import __version__
from relight.settings import ROOT


def provenance(name: str, run: dict[str, Any]) -> dict[str, Any]:
    """Collects the provenance of the report of a run in results/<name>, by its record (`Results.run`).

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
        "command": command(name, run),
    }


def machine() -> str:
    """Describes cores, memory, GPU and system, without the host name."""
    import torch

    cores = count_cores()
    parts = [f"{cores} core{'s' * (cores != 1)}", f"{psutil.virtual_memory().total / 2**30:.0f} GiB"]
    parts += [torch.cuda.get_device_name(0)] if torch.cuda.is_available() else []
    return "; ".join([*parts, f"{platform.system()} {platform.machine()}", f"Python {platform.python_version()}"])


def command(name: str, run: dict[str, Any]) -> str:
    """Returns the command that repeats a run in a clone; a sweep is repeated from its record, run.yaml."""
    if list(run["settings"]["experiments"]) == ["sweep"]:
        return f"snakemake all --configfile results/{name}/run.yaml"
    return without_passwords(shlex.join(["relight", "run", *run["overrides"]]))
