"""`relight run`: the whole workflow with Hydra overrides, and a run that was killed taken up again."""

import fcntl
import itertools
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml

from relight.config import ROOT
from relight.files import UserError, whole
from relight.workflow import Plan

LOGGER = ["--logger", "relight"]  # also what tells a Snakemake of ours from one started by hand
LOCK = ROOT / ".snakemake" / "relight.lock"


def run(
    overrides: list[str], multirun: bool, cores: int | None, dry: bool, targets: list[str], extra: list[str]
) -> int:
    """Checks the settings, then lets Snakemake do what is missing; returns its exit code.

    The settings go through a file, results/<name>/run.yaml: nested quotes in `--config` break on the way to Slurm
    jobs, and the file says afterwards what was asked for. Raises UserError for settings that cannot be.
    """
    config: dict = {"hydra": overrides}
    if multirun:
        fixed, config["runs"] = swept(overrides)
        config["hydra"] = fixed
    plan = Plan(config)
    plan.look()
    for name in plan.runs:
        plan.of_run(name)  # a wrong override of the sweep is told now, not when its turn comes
    file = ROOT / plan.out / "run.yaml"
    with whole(file) as tmp:
        tmp.write_text(yaml.safe_dump(config))
    command = [sys.executable, "-m", "snakemake", *targets, "--configfile", str(file), *extra]
    if cores:
        command += ["--cores", str(cores)]
    if dry:
        return subprocess.call([*command, "--dry-run"], cwd=ROOT)
    with alone():
        code = snakemake([*command, *LOGGER])
        page = ROOT / plan.out / "report" / "snakemake.html"
        if code == 0 and targets == ["all"] and stale(page, page.with_name("report.html")):
            with whole(page) as tmp:
                code = snakemake([*command, "--report", str(tmp), "--quiet", "all"], stdout=subprocess.DEVNULL)
        if code == 0 and targets == ["all"]:
            print(f"the report: {page.with_name('report.html')}")
        return code


def snakemake(command: list[str], **streams) -> int:
    """Runs Snakemake in this repository, with our plugins; returns its exit code."""
    paths = [str(ROOT / "workflow" / "plugins"), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.call(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, **streams)


def stale(made: Path, source: Path) -> bool:
    """Whether `made` is missing or older than what it was made from."""
    return not made.exists() or made.stat().st_mtime < source.stat().st_mtime


def swept(overrides: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Splits overrides into the fixed ones and the product of the swept ones, as runs by name.

    train.lr=1e-4,2e-4 loss=min,full scale=demo -> [scale=demo], {"lr_0.0001-loss_min": [...], ...}
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    try:
        parsed = OverridesParser.create().parse_overrides(overrides)
    except HydraException as error:
        raise UserError(f"cannot read the overrides: {' '.join(str(error).split())}") from None
    fixed = [text for text, override in zip(overrides, parsed) if not override.is_sweep_override()]
    axes = [
        [(override.get_key_element(), value) for value in override.sweep_string_iterator()]
        for override in parsed
        if override.is_sweep_override()
    ]
    if not axes:
        raise UserError("-m sweeps over lists, such as train.lr=1e-4,2e-4: none of the overrides is one")
    runs = {}
    for choice in itertools.product(*axes):
        name = "-".join(f"{key.rpartition('.')[2]}_{value}" for key, value in choice)
        runs[re.sub(r"[^A-Za-z0-9._+-]+", "_", name)] = [f"{key}={value}" for key, value in choice]
    return fixed, runs


@contextmanager
def alone() -> Iterator[None]:
    """Holds this folder for one workflow; what a killed one left behind (its lock, its jobs) is cleared first.

    Raises UserError while another workflow is alive in the folder.
    """
    LOCK.parent.mkdir(exist_ok=True)
    with open(LOCK, "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(f"another `relight run` is at work in {ROOT}: wait for it, or end it") from None
        end_orphans()
        for lock in (ROOT / ".snakemake" / "locks").glob("*"):
            lock.unlink()
        yield


def end_orphans() -> None:
    """Ends the Snakemake and the jobs whose `relight run` was killed; the new run does their work again, or resumes it.

    Only called by the one that holds LOCK: a Snakemake that `relight run` started has lost its caller then. Raises
    UserError when Snakemake was started by hand in this folder and is at work.
    """
    import psutil

    ours = {os.getpid(), *(parent.pid for parent in psutil.Process().parents())}
    here = [p for p in psutil.process_iter(["pid", "cmdline", "cwd"]) if p.info["cwd"] == str(ROOT)]
    flows, jobs = [], []
    for process in here:
        words = process.info["cmdline"] or []
        if process.info["pid"] in ours:
            continue
        if "snakemake" in (Path(word).name for word in words[:3]):
            if words[-2:] != LOGGER:
                number = process.info["pid"]
                raise UserError(f"Snakemake is at work in {ROOT} (process {number}): wait for it, or end it")
            flows.append(process)
        elif any(word.startswith("relight.stages.") for word in words):
            jobs.append(process)
    for process in [*flows, *jobs]:  # Snakemake first, so that it starts no new job
        process.kill()
    psutil.wait_procs([*flows, *jobs], timeout=10)
