"""`relight run`: runs the whole workflow with Hydra overrides, and resumes a run that was killed."""

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

from relight.config import CONF, MAX_NAME_LENGTH, ROOT
from relight.config.composition import quoted
from relight.config_folder import ConfigFolder
from relight.errors import UserError
from relight.files import atomic_write, writable_folder
from relight.plan import Plan
from relight.processes import end_with_parent

RUN_VARIABLE = "RELIGHT_RUN"  # environment variable that marks the Snakemake that `relight run` started, and its jobs
LOCK = ROOT / ".snakemake" / "relight.lock"


def run(
    overrides: list[str], multirun: bool, cores: int | None, dry: bool, targets: list[str], extra: list[str]
) -> int:
    """Checks the settings, then runs Snakemake to make the missing files.

    The settings are passed in a file, results/<name>/run.yaml, since Slurm jobs break nested quotes in `--config`, and
    as a record. A dry run writes a temporary file.

    Args:
        overrides: settings to override, in the syntax of Hydra.
        multirun: sweep over all combinations of the overrides with several values.
        cores: number of jobs at the same time; by default the number of cores.
        dry: only print what would run.
        targets: rules or files.
        extra: further arguments for Snakemake.

    Returns:
        Snakemake's exit code.

    Raises:
        UserError: if settings are invalid, or another workflow is running in this folder.
    """
    config: dict[str, Any] = {"hydra": overrides}
    if multirun:
        config["hydra"], config["rows"] = expand_sweep(overrides)
    plan = Plan(config)
    plan.check()
    if targets == ["all"]:
        plan.check_figures()
    if multirun:
        for word in (word for word in overrides if word.startswith("experiment=")):
            print(f"{word} gives its settings, and none of its rows: the sweep has its own")
        for row, words in plan.rows.items():
            print(f"{row}: {' '.join(words)}")
    for line in change_lines(plan):
        print(line)
    command = [sys.executable, "-m", "snakemake", *targets, *extra]
    command += ["--logger", "relight", "--logger-relight-results", plan.out]
    if cores:
        command += ["--cores", str(cores)]
    if dry:
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            yaml.safe_dump(config, file)
            file.flush()
            return snakemake([*command, "--configfile", file.name, "--dry-run"])
    with lock_folder():
        fix_future_dates(ROOT / plan.out)
        ConfigFolder(plan).update()
        command += ["--configfile", str(plan.write_record(ROOT))]
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


def change_lines(plan: Plan) -> list[str]:
    """Returns what to say before existing results are made again: why, by which stages, and how to keep them.

    Returns:
        A line about changed settings, and one about changed code; none of what has not changed.
    """
    changes = ConfigFolder(plan).changes()
    settings = sorted({key for keys in changes.values() for key in keys} - {"code"})
    lines = []
    if settings:
        stages = [stage for stage, keys in changes.items() if keys != ["code"]]
        shown = ", ".join(settings[:4]) + (f" and {len(settings) - 4} more" if len(settings) > 4 else "")
        lines.append(
            f"{plan.out} was made with other settings ({shown}): {', '.join(stages)} and what depends on them are made "
            "again; to keep both, give this run a name, name=NAME"
        )
    if stages := [stage for stage, keys in changes.items() if "code" in keys]:
        lines.append(
            f"the code of {', '.join(stages)} has changed since {plan.out} was made: they run again; "
            f"pin=[{','.join(stages)}] keeps their results"
        )
    return lines


def snakemake(command: list[str], stdout: int | None = None) -> int:
    """Runs Snakemake in this repository, with its plugins.

    Snakemake and its jobs end with this process. On INT, TERM and HUP, `stop` ends them. If this process is killed, the
    kernel kills Snakemake, and the jobs end themselves (`relight.processes`).

    Args:
        command: the program and its arguments, such as python -m snakemake all.
        stdout: file descriptor for its output, or `subprocess.DEVNULL`; by default that of this process.

    Returns:
        The exit code.
    """
    paths = [str(ROOT / "workflow" / "plugins")]
    if "PYTHONPATH" in os.environ:
        paths.append(os.environ["PYTHONPATH"])
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:  # with nohup, HUP stays ignored
            signal.signal(number, signal.default_int_handler)
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **cache_environment(), "PYTHONPATH": os.pathsep.join(paths), RUN_VARIABLE: str(os.getpid())},
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
    """Returns variables that move the caches of Snakemake and the stages here, if the user's cache is read-only.

    Otherwise Snakemake would end with a traceback.
    """
    import platformdirs

    try:
        writable_folder(platformdirs.user_cache_dir(), "cache")
    except UserError:
        return {"XDG_CACHE_HOME": str(ROOT / ".snakemake" / "cache")}
    return {}


def prepare_child(parent: int) -> None:
    """Prepares Snakemake's process: enables INT, which scripts and cron ignore, and ties it to its parent."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent(parent)


def stop(process: subprocess.Popen[bytes]) -> None:
    """Ends Snakemake and its jobs, and waits until they have ended.

    On INT, Snakemake starts no more jobs, cancels those on a cluster, and waits for those on this machine, which are
    terminated here.
    """
    import psutil

    process.send_signal(signal.SIGINT)
    while process.poll() is None:
        with suppress(psutil.NoSuchProcess):
            for job in psutil.Process(process.pid).children(recursive=True):
                job.terminate()
        time.sleep(0.2)


def suspend(process: subprocess.Popen[bytes], *_: Any) -> None:
    """Handles Ctrl-Z (SIGTSTP): suspends Snakemake and its jobs, and resumes them together with this process.

    Args:
        process: Snakemake, the leader of its own process group.
        _: number of the signal and stack frame, which Python passes to handlers.
    """
    os.killpg(process.pid, signal.SIGSTOP)
    try:
        os.kill(os.getpid(), signal.SIGSTOP)
    finally:  # also if another signal arrives together with SIGCONT
        os.killpg(process.pid, signal.SIGCONT)


def expand_sweep(overrides: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Expands a sweep to rows: one for each combination of the overrides with several values.

    Args:
        overrides: settings to override, in the syntax of Hydra; several values are written as train.lr=1e-4,2e-4.

    Returns:
        The overrides with one value, and the overrides of each row by its name.

    >>> expand_sweep(["train.lr=1e-4,2e-4", "scale=demo"])
    (['scale=demo'], {'lr_0.0001': ['train.lr=0.0001'], 'lr_0.0002': ['train.lr=0.0002']})

    Raises:
        UserError: if an override cannot be parsed or is an interval, or none has several values.
    """
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    fixed, axes = [], []
    overrides = [override if "," in override else quoted(override) for override in overrides]
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            parser = OverridesParser.create(GlobalHydra.instance().config_loader())  # expands glob(*)
            for text, override in zip(overrides, parser.parse_overrides(overrides)):
                if not override.is_sweep_override():
                    fixed.append(text)
                elif override.is_interval_sweep():
                    raise UserError(f"{text} is not a list of values: write them out, as in train.lr=1e-4,2e-4")
                else:
                    axes.append([(override.get_key_element(), value) for value in override.sweep_string_iterator()])
    except HydraException as error:
        raise UserError(f"cannot read the overrides: {' '.join(str(error).split())}") from None
    if not axes:
        raise UserError("-m sweeps over lists, such as train.lr=1e-4,2e-4: give an override with several values")
    rows: dict[str, list[str]] = {}
    for choice in itertools.product(*axes):
        words = [f"{key}={value}" for key, value in choice]
        name = "-".join(f"{key.lstrip('+').rpartition('.')[2]}_{value}" for key, value in choice)
        safe_name = re.sub(r"[^A-Za-z0-9._+-]+", "_", name)
        if len(safe_name) > MAX_NAME_LENGTH or rows.get(safe_name, words) != words:
            ending = f"-{hashlib.sha256(name.encode()).hexdigest()[:8]}"  # makes a cut or an ambiguous name unique
            safe_name = safe_name[: MAX_NAME_LENGTH - len(ending)] + ending
        rows[safe_name] = words
    return fixed, rows


@contextmanager
def lock_folder() -> Iterator[None]:
    """Locks this folder for one workflow, and removes the locks and jobs of a workflow that was killed.

    Raises:
        UserError: if another workflow is running in the folder, or it is read-only.
    """
    try:
        LOCK.parent.mkdir(exist_ok=True)
        file = open(LOCK, "w")
    except OSError as error:
        reason = os.strerror(error.errno or 0).lower()
        raise UserError(f"nothing can be written in {ROOT} ({reason}): the workflow stores its records there") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(f"another `relight run` is running in {ROOT}: wait for it, or end it") from None
        kill_orphans()
        for lock in (ROOT / ".snakemake" / "locks").glob("*"):
            lock.unlink()
        yield


def fix_future_dates(folder: Path) -> None:
    """Sets dates in the future to now, since Snakemake ends jobs whose outputs are older than their inputs.

    Such files exist if the clock was ahead when they were made.
    """
    now = time.time()
    for path in folder.rglob("*"):
        if path.lstat().st_mtime > now:
            os.utime(path, (now, now), follow_symlinks=False)


def kill_orphans() -> None:
    """Kills the Snakemake and the jobs of a `relight run` that was killed; the new run repeats or resumes their work.

    They have RUN_VARIABLE in their environment. Since the caller holds LOCK, their own caller has ended.

    Raises:
        UserError: if a Snakemake that was started by hand is running in this folder.
    """
    import psutil

    callers = {os.getpid(), *(parent.pid for parent in psutil.Process().parents())}
    workflows, jobs = [], []
    for process in psutil.process_iter(["pid", "cmdline", "cwd", "environ"]):
        words, environment = process.info["cmdline"] or [], process.info["environ"] or {}
        if process.info["cwd"] != str(ROOT) or process.info["pid"] in callers:
            continue
        if "snakemake" in (Path(word).name for word in words[:3]):  # also `python -m snakemake`
            if RUN_VARIABLE not in environment:
                number = process.info["pid"]
                raise UserError(f"Snakemake is running in {ROOT} (process {number}): wait for it, or end it")
            workflows.append(process)
        elif RUN_VARIABLE in environment:
            jobs.append(process)
    for process in [*workflows, *jobs]:  # Snakemake first, so that it starts no further job
        process.kill()
    psutil.wait_procs([*workflows, *jobs], timeout=10)
