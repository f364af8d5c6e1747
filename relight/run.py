"""`relight run`: the whole workflow with Hydra overrides, and a run that was killed taken up again."""

import fcntl
import hashlib
import itertools
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from relight.config import CONF, LONGEST, ROOT
from relight.files import UserError, atomic_write, writable_folder
from relight.processes import end_with_parent
from relight.workflow import Plan

MARK = "RELIGHT_RUN"  # in the environment of a Snakemake that `relight run` started, and of its jobs
LOCK = ROOT / ".snakemake" / "relight.lock"


def run(
    overrides: list[str], multirun: bool, cores: int | None, dry: bool, targets: list[str], extra: list[str]
) -> int:
    """Checks the settings, then has Snakemake make what is missing.

    The settings go through a file, results/<name>/run.yaml: nested quotes in `--config` break on the way to Slurm
    jobs, and the file records what was requested. A dry run writes to a temporary one.

    Args:
        overrides: Hydra's.
        multirun: try each combination of values that are lists.
        cores: jobs side by side; all cores by default.
        dry: only print what would run.
        targets: rules or files.
        extra: further arguments of Snakemake's.

    Returns:
        Snakemake's exit code.

    Raises:
        UserError: settings that cannot be, or another workflow is running in this folder.
    """
    config: dict[str, Any] = {"hydra": overrides}
    if multirun:
        config["hydra"], config["runs"] = expand_sweep(overrides)
    plan = Plan(config)
    plan.check()
    if multirun:
        for row, words in plan.rows.items():
            print(f"{row}: {' '.join(words)}")
    command = [sys.executable, "-m", "snakemake", *targets, *extra]
    if cores:
        command += ["--cores", str(cores)]
    if dry:
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            yaml.safe_dump(config, file)
            file.flush()
            return snakemake([*command, "--configfile", file.name, "--dry-run"])
    with lock_folder():
        date_now(ROOT / plan.out)
        command += ["--configfile", str(plan.write_record(ROOT)), "--logger", "relight"]
        command += ["--logger-relight-results", plan.out, "--logger-relight-scale", plan.scale]
        code = snakemake(command)
        if code == 0 and targets == ["all"]:
            report = ROOT / plan.out / "report" / "report.html"
            page = report.with_name("snakemake.html")
            if not page.exists() or page.stat().st_mtime < report.stat().st_mtime:
                with atomic_write(page) as tmp:
                    words = ["--report", str(tmp), "--quiet", "all"]
                    code = snakemake([*command, *words], stdout=subprocess.DEVNULL)
            if code == 0:
                print(f"the report: {report}")
        return code


def snakemake(command: list[str], stdout: int | None = None) -> int:
    """Runs Snakemake in this repository, with our plugins.

    Snakemake and its jobs end with this process. INT, TERM and HUP reach them through `stop`; where this process is
    killed, the kernel kills Snakemake, and the jobs notice (`relight.processes`).

    Args:
        command: its words.
        stdout: as of `subprocess.Popen`.

    Returns:
        Its exit code.
    """
    paths = [str(ROOT / "workflow" / "plugins"), *filter(None, [os.environ.get("PYTHONPATH")])]
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup ignores HUP
            signal.signal(number, signal.default_int_handler)
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **cache_environment(), "PYTHONPATH": os.pathsep.join(paths), MARK: str(os.getpid())},
        process_group=0,  # so that Ctrl-C reaches Snakemake once, from here
        preexec_fn=partial(prepare_child, os.getpid()),
        stdout=stdout,
    )
    signal.signal(signal.SIGTSTP, partial(suspend, process))
    try:
        return process.wait()
    except KeyboardInterrupt:
        stop(process)
        raise
    finally:
        signal.signal(signal.SIGTSTP, signal.SIG_DFL)


def cache_environment() -> dict[str, str]:
    """Variables that move the caches of Snakemake and of the stages to this folder, where the user's cannot be written.

    Snakemake ends with a traceback otherwise.
    """
    import platformdirs

    try:
        writable_folder(platformdirs.user_cache_dir(), "cache")
    except UserError:
        return {"XDG_CACHE_HOME": str(ROOT / ".snakemake" / "cache")}
    return {}


def prepare_child(parent: int) -> None:
    """Called in Snakemake's process before it starts: it must not ignore INT, as what scripts and cron start does."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent(parent)


def stop(process: subprocess.Popen[bytes]) -> None:
    """Ends Snakemake and its jobs, and waits for that.

    On INT, Snakemake starts nothing more, cancels what a cluster runs, and waits for the jobs on this machine, which
    are ended here.
    """
    import psutil

    process.send_signal(signal.SIGINT)
    while process.poll() is None:
        with suppress(psutil.NoSuchProcess):
            for job in psutil.Process(process.pid).children(recursive=True):
                job.terminate()
        time.sleep(0.2)


def suspend(process: subprocess.Popen[bytes], *_: Any) -> None:
    """The handler of Ctrl-Z: the jobs stop, too, and continue when this process does."""
    os.killpg(process.pid, signal.SIGSTOP)
    try:
        os.kill(os.getpid(), signal.SIGSTOP)
    finally:  # also when another signal comes with the one that continues
        os.killpg(process.pid, signal.SIGCONT)


def expand_sweep(overrides: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Expands a sweep to the runs of a table: one for each combination of the overrides that have several values.

    Args:
        overrides: Hydra's; those with several values are lists such as train.lr=1e-4,2e-4.

    Returns:
        The overrides with one value; and the overrides of each run by its name.

    >>> expand_sweep(["train.lr=1e-4,2e-4", "scale=demo"])
    (['scale=demo'], {'lr_0.0001': ['train.lr=0.0001'], 'lr_0.0002': ['train.lr=0.0002']})

    Raises:
        UserError: an override cannot be read, is an interval, or none has several values.
    """
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    fixed, axes = [], []
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            parser = OverridesParser.create(GlobalHydra.instance().config_loader())  # knows what glob(*) stands for
            for text, override in zip(overrides, parser.parse_overrides(overrides)):
                if not override.is_sweep_override():
                    fixed.append(text)
                elif override.is_interval_sweep():
                    raise UserError(f"{text} is no list of values: write them out, as in train.lr=1e-4,2e-4")
                else:
                    axes.append([(override.get_key_element(), value) for value in override.sweep_string_iterator()])
    except HydraException as error:
        raise UserError(f"cannot read the overrides: {' '.join(str(error).split())}") from None
    if not axes:
        raise UserError("-m sweeps over lists, such as train.lr=1e-4,2e-4: none of the overrides is one")
    runs: dict[str, list[str]] = {}
    for choice in itertools.product(*axes):
        words = [f"{key}={value}" for key, value in choice]
        name = "-".join(f"{key.lstrip('+').rpartition('.')[2]}_{value}" for key, value in choice)
        plain = re.sub(r"[^A-Za-z0-9._+-]+", "_", name)
        if len(plain) > LONGEST or runs.get(plain, words) != words:
            plain = f"{plain[: LONGEST - 9]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
        runs[plain] = words
    return fixed, runs


@contextmanager
def lock_folder() -> Iterator[None]:
    """Holds this folder for one workflow, and clears the lock and the jobs of one that was killed.

    Raises:
        UserError: another workflow is running in the folder, or it cannot be written.
    """
    try:
        LOCK.parent.mkdir(exist_ok=True)
        file = open(LOCK, "w")
    except OSError as error:
        reason = os.strerror(error.errno or 0).lower()
        raise UserError(f"nothing can be written in {ROOT} ({reason}): the workflow keeps its records there") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(f"another `relight run` is at work in {ROOT}: wait for it, or end it") from None
        end_orphans()
        for lock in (ROOT / ".snakemake" / "locks").glob("*"):
            lock.unlink()
        yield


def date_now(folder: Path) -> None:
    """Dates files of the future now: the clock was ahead when they were made, and Snakemake ends each job whose outputs
    are older than its inputs."""
    now = time.time()
    for path in folder.rglob("*"):
        if path.stat().st_mtime > now:
            os.utime(path, (now, now))


def end_orphans() -> None:
    """Ends the Snakemake and the jobs of a `relight run` that was killed; the new run repeats or resumes their work.

    They are known by MARK in their environment. Only called while LOCK is held, so what is found has lost its caller.

    Raises:
        UserError: a Snakemake that was started by hand is running in this folder.
    """
    import psutil

    callers = {os.getpid(), *(parent.pid for parent in psutil.Process().parents())}
    workflows, jobs = [], []
    for process in psutil.process_iter(["pid", "cmdline", "cwd", "environ"]):
        words, environment = process.info["cmdline"] or [], process.info["environ"] or {}
        if process.info["cwd"] != str(ROOT) or process.info["pid"] in callers:
            continue
        if "snakemake" in (Path(word).name for word in words[:3]):
            if MARK not in environment:
                number = process.info["pid"]
                raise UserError(f"Snakemake is at work in {ROOT} (process {number}): wait for it, or end it")
            workflows.append(process)
        elif MARK in environment:
            jobs.append(process)
    for process in [*workflows, *jobs]:  # Snakemake first, so that it starts no further job
        process.kill()
    psutil.wait_procs([*workflows, *jobs], timeout=10)
