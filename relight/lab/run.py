"""`relight run`: composes the settings, and calls Snakemake."""

import fcntl
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from shutil import which

from relight.core.errors import UserError
from relight.core.processes import end_with_parent
from relight.lab.checks import check, check_figures
from relight.lab.plan import Plan
from relight.lab.record import compose_run, expand_sweep, read_record
from relight.settings import CONF, ROOT

LOCK = "lock"  # a file of the results, locked as long as a workflow makes them; Snakemake's own stay after a kill
HOLDER = "RELIGHT_HOLDER"  # variable with the process that has locked the results for its Snakemake
INTERRUPTED = 130  # exit code after Ctrl-C


def run(
    overrides: list[str], multirun: bool, cores: int | None, dry: bool, targets: list[str], extra: list[str]
) -> int:
    """Checks the settings, writes results/<name>/run.yaml, and runs Snakemake to make the missing files.

    After a failure, the report of the experiments that are complete is made.

    Args:
        overrides: settings to override, in the syntax of Hydra.
        multirun: sweep over all combinations of the overrides with several values.
        cores: number of jobs at the same time; by default the number of cores.
        dry: only print what would run.
        targets: rules or files.
        extra: further arguments for Snakemake.

    Returns:
        Snakemake's exit code; INTERRUPTED after Ctrl-C.

    Raises:
        UserError: if settings are invalid or without effect, or another workflow makes the same results.
    """
    given, overrides = overrides, with_remembered(overrides)
    if kept := overrides[: len(overrides) - len(given)]:
        print(f"goes on with {shlex.join(kept)}")
    fixed, rows = expand_sweep(overrides) if multirun else (overrides, rows_of_sweep(given))
    if rows:
        for word in (word for word in overrides if word.startswith("experiment=")):
            print(f"{word} gives its settings, and none of its rows: the sweep has its own")
        for row, words in rows.items():
            print(f"{row}: {' '.join(words)}")
    plan = Plan(compose_run(fixed, rows))
    check(plan)
    for word in given:
        key = word.partition("=")[0]
        has_own = [any(own.startswith(f"{key}=") for own in words) for words in plan.rows.values()]
        if word in fixed and has_own and all(has_own):
            raise UserError(f"{word} has no effect, since each row has its own {key}: give experiment=one, or leave it")
    if targets == ["all"]:
        check_figures(plan)
    device, gpu = plan.shared["train"]["device"], []
    apart = any(word.startswith(("--profile", "--executor", "-e", "--resources")) for word in extra)  # as of a cluster
    if not apart and (plan.gpus or (device == "auto" and which("nvidia-smi"))):
        from relight.learning.data import choose_device

        if choose_device(device).type == "cuda":  # one job at a time on it
            gpu = ["--resources", "gpu=1", "--set-resources", "train:gpu=1", "evaluate:gpu=1"]
    if any("slurm" in word for word in extra):
        import_module("snakemake_executor_plugin_slurm")  # without it Snakemake prints its whole usage
    words = ["--quiet", "rules", "reason", "host", "--nolock", *gpu, "--cores", str(cores or "all"), *extra]
    rules = [target for target in targets if "/" not in target and target != "all"]
    known = {path.stem for path in CONF.parent.glob("workflow/scripts/*.py")} - {"figure" if plan.scans else "scan"}
    if unknown := [rule for rule in rules if rule not in known]:
        raise UserError(f"--target {unknown[0]} is neither a file nor a rule of this run: {', '.join(sorted(known))}")
    files = [target for target in targets if target not in rules] or ["all"]
    words += ["--until", *rules] if rules else []  # of each figure or training, too
    command = [sys.executable, "-m", "snakemake", *files, *words]
    if dry:
        with tempfile.TemporaryDirectory() as folder:
            command += ["--configfile", str(plan.write_record(folder)), "--dry-run"]
            ran = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, process_group=0)
        first, *tables = ran.stdout.split("Job stats:\n")  # which Snakemake prints twice
        print(first, *tables[-1:], sep="Job stats:\n", end="")
        return ran.returncode
    held = hold_all(plan, ROOT)
    # In a file, since jobs on a cluster break quotes within quotes.
    command += ["--configfile", str(plan.write_record())]
    if (code := snakemake(command, held)) == INTERRUPTED:
        print("interrupted; the same command goes on", file=sys.stderr)
    elif targets == ["all"] and code == 0:
        print(f"the report: {ROOT / plan.out / 'report' / 'report.html'}")
    elif targets == ["all"] and (failed := plan.missing_results()):
        print(f"failed: {', '.join(failed)}; the report of the others follows", file=sys.stderr)
        plan.record["failed"] = failed
        plan.write_record()
        snakemake(command, held)
        del plan.record["failed"]  # the next run tries them again
        plan.write_record()
    for handle in held:
        os.close(handle)
    return code


def with_remembered(overrides: list[str]) -> list[str]:
    """Returns overrides behind those of the run that they name, or else of the run whose data they take."""
    given = dict(word.partition("=")[::2] for word in overrides)
    records = (read_record(ROOT / "results" / given[key])["overrides"] for key in ("name", "data") if key in given)
    before: list[str] = next(filter(None, records), [])
    kept = [word for word in before if word.partition("=")[0] not in {*given, "name"}]
    # A path stays written as that run has it, or its data would be made again.
    same = {(key, os.path.realpath(ROOT / path)): word for word in before for key, _, path in [word.partition("=")]}
    keys = [(key, os.path.realpath(path)) for key, _, path in (word.partition("=") for word in overrides)]
    return [*kept, *(same.get(key, word) for key, word in zip(keys, overrides))]


def rows_of_sweep(given: list[str]) -> dict[str, list[str]] | None:
    """Returns the rows of the run that overrides name if it is a sweep, and they give no other experiment or rows."""
    name = dict(word.partition("=")[::2] for word in given).get("name", "")
    settings = read_record(ROOT / "results" / name)["settings"]
    others = any(re.match(r"\+*(experiment|sweep\.rows)", word) for word in given)
    return settings["sweep"]["rows"] if "sweep" in settings.get("experiments", {}) and not others else None


def snakemake(command: list[str], held: Collection[int] = ()) -> int:
    """Runs Snakemake in this repository. It ends with this process, and its jobs end with it (`relight.lab.job`).

    It inherits the handles of locks. Returns its exit code, or INTERRUPTED if this process was interrupted or ended.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:  # with nohup, HUP stays ignored
            signal.signal(number, signal.default_int_handler)
    parent = os.getpid()

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # which scripts and cron ignore
        end_with_parent(parent)
        os.environ[HOLDER] = str(parent)

    # A process group of its own, so that Ctrl-C reaches it once, from here.
    process = subprocess.Popen(
        command, cwd=ROOT, process_group=0, preexec_fn=prepare, stderr=subprocess.PIPE, pass_fds=held
    )
    try:
        for line in process.stderr or ():
            with suppress(OSError):  # a closed terminal
                os.write(2, line)
        return process.wait()
    except KeyboardInterrupt:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        process.communicate()  # drops their tracebacks
        return INTERRUPTED


def hold_all(plan: Plan, folder: Path) -> list[int]:
    """Locks the results of a plan in a folder, and the data of another run for reading, by `hold`."""
    return [*([hold(folder / plan.data, shared=True)] if plan.data != plan.out else []), hold(folder / plan.out)]


def hold(out: Path | str, shared: bool = False) -> int:
    """Locks results until this process ends, however it ends, or closes the handle that this returns.

    With `shared`, others may read them, too. Raises UserError if another workflow makes them, or they are read-only.
    """
    try:
        Path(out).mkdir(parents=True, exist_ok=True)
        handle = os.open(Path(out, LOCK), os.O_CREAT | (os.O_RDONLY if shared else os.O_RDWR))
        fcntl.flock(handle, fcntl.LOCK_NB | (fcntl.LOCK_SH if shared else fcntl.LOCK_EX))
    except BlockingIOError:
        raise UserError(f"another workflow is making {out}: wait for it, or end it") from None
    except OSError as error:
        raise UserError(f"{out} cannot be written: {os.strerror(error.errno or 0).lower()}") from None
    return handle
