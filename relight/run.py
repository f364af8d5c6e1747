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

import yaml

from relight.config import CONF, LONGEST, ROOT
from relight.files import UserError, atomic_write, writable_folder
from relight.processes import end_with_parent
from relight.workflow import Plan

LOGGER = ["--logger", "relight"]  # also what tells a Snakemake of ours from one started by hand
LOCK = ROOT / ".snakemake" / "relight.lock"


def run(
    overrides: list[str], multirun: bool, cores: int | None, dry: bool, targets: list[str], extra: list[str]
) -> int:
    """Checks the settings, then lets Snakemake do what is missing; returns its exit code.

    The settings go through a file, results/<name>/run.yaml: nested quotes in `--config` break on the way to Slurm
    jobs, and the file says afterwards what was asked for. A dry run leaves it alone. Raises UserError for settings that
    cannot be.
    """
    config: dict = {"hydra": overrides}
    if multirun:
        fixed, config["runs"] = swept(overrides)
        config["hydra"] = fixed
    plan = Plan(config)
    plan.look()
    for name in plan.runs:
        plan.of_run(name)  # a wrong override of the sweep is told now, not when its turn comes
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
    with alone():
        date_now(ROOT / plan.out)
        command += ["--configfile", str(plan.record(ROOT))]
        code = snakemake([*command, *LOGGER])
        if code > 0 and targets == ["all"] and (failed := plan.failures(ROOT)):
            report_without(failed, plan, config, command)
        page = ROOT / plan.out / "report" / "snakemake.html"
        if code == 0 and targets == ["all"] and stale(page, page.with_name("report.html")):
            with atomic_write(page) as tmp:
                code = snakemake([*command, "--report", str(tmp), "--quiet", "all"], stdout=subprocess.DEVNULL)
        if code == 0 and targets == ["all"]:
            print(f"the report: {page.with_name('report.html')}")
        return code


def report_without(failed: dict[str, list[str]], plan: Plan, config: dict, command: list[str]) -> None:
    """Makes the report of the experiments that did not fail; those that did have a section that says so.

    What failed is tried again by the next run, whose files are still missing.
    """
    file = ROOT / plan.out / "failed.yaml"  # beside run.yaml, where a cluster's jobs can read it
    with atomic_write(file) as tmp:
        tmp.write_text(yaml.safe_dump({**config, "failed": failed}))
    try:
        place = command.index("--configfile") + 1
        again = snakemake([*command[:place], str(file), *command[place + 1 :], *LOGGER])
    finally:
        file.unlink()
    if again == 0:
        page = ROOT / plan.out / "report" / "report.html"
        print(f"failed: {', '.join(failed)}; the report of the others: {page}", file=sys.stderr)


def snakemake(command: list[str], **streams) -> int:
    """Runs Snakemake in this repository, with our plugins; returns its exit code.

    It ends with this process, and its jobs with it. INT, TERM and HUP reach them through `end`; when this process is
    killed outright, the kernel kills Snakemake, and the jobs notice (`relight.processes`).
    """
    paths = [str(ROOT / "workflow" / "plugins"), *filter(None, [os.environ.get("PYTHONPATH")])]
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup ignores HUP
            signal.signal(number, signal.default_int_handler)
    flow = subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **cache(), "PYTHONPATH": os.pathsep.join(paths)},
        process_group=0,  # Ctrl-C is ours to pass on, once
        preexec_fn=partial(begin, os.getpid()),
        **streams,
    )
    signal.signal(signal.SIGTSTP, partial(pause, flow))
    try:
        return flow.wait()
    except KeyboardInterrupt:
        end(flow)
        raise
    finally:
        signal.signal(signal.SIGTSTP, signal.SIG_DFL)


def cache() -> dict[str, str]:
    """Variables that keep the caches of Snakemake and of the stages in this folder, where the user's own one is not to
    be written: Snakemake ends with a trace without."""
    import platformdirs

    try:
        writable_folder(platformdirs.user_cache_dir(), "cache")
    except UserError:
        return {"XDG_CACHE_HOME": str(ROOT / ".snakemake" / "cache")}
    return {}


def begin(parent: int) -> None:
    """Starts Snakemake's process: scripts and cron start programs that ignore INT, and it must not."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent(parent)


def end(flow: subprocess.Popen) -> None:
    """Ends Snakemake and its jobs, and waits for that.

    Snakemake takes INT for: start nothing more, cancel what a cluster runs, wait for the jobs on this machine. Those
    are ended here.
    """
    import psutil

    flow.send_signal(signal.SIGINT)
    while flow.poll() is None:
        with suppress(psutil.NoSuchProcess):
            for job in psutil.Process(flow.pid).children(recursive=True):
                job.terminate()
        time.sleep(0.2)


def pause(flow: subprocess.Popen, *_) -> None:
    """Ctrl-Z stops the jobs, too; they go on when this process does."""
    os.killpg(flow.pid, signal.SIGSTOP)
    try:
        os.kill(os.getpid(), signal.SIGSTOP)
    finally:  # also when another signal comes with the one that continues
        os.killpg(flow.pid, signal.SIGCONT)


def stale(made: Path, source: Path) -> bool:
    """Whether `made` is missing or older than what it was made from."""
    return not made.exists() or made.stat().st_mtime < source.stat().st_mtime


def swept(overrides: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Splits overrides into the fixed ones and the product of the swept ones, as runs by name.

    train.lr=1e-4,2e-4 loss=min,full scale=demo -> [scale=demo], {"lr_0.0001-loss_min": [...], ...}
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
def alone() -> Iterator[None]:
    """Holds this folder for one workflow; what a killed one left behind (its lock, its jobs) is cleared first.

    Raises UserError while another workflow is alive in the folder.
    """
    try:
        LOCK.parent.mkdir(exist_ok=True)
        file = open(LOCK, "w")
    except OSError as error:
        reason = os.strerror(error.errno).lower()
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
