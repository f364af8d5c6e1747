"""What a kill leaves: the next run goes on, and ends in the same bytes."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from repo import OUT, WORDS, at_work, check_mlflow, copy, hashes, outputs, relight, start

KILLS = int(os.environ.get("RELIGHT_CHAOS", "2"))  # `make chaos` takes 60
KINDS = ("group", "SIGKILL", "job", "SIGTERM", "snakemake", "SIGINT", "SIGHUP")
PART_OF = {"snakemake": "-m snakemake", "job": ".snakemake/scripts/"}

pytestmark = pytest.mark.slow


def names(repo: Path) -> set[str]:
    """All that is in the folder of the repository, and all files of its results but Snakemake's own."""
    found = [path for path in [*repo.iterdir(), *(repo / OUT).rglob("*")] if path.name != ".snakemake_timestamp"]
    return {str(path.relative_to(repo)) for path in found}


def kill(kind: str, command: subprocess.Popen, repo: Path) -> bool:
    """Ends a part of the workflow: all of it, Snakemake, one of its jobs, or the command by a signal.

    Returns whether there was something to end: False when the workflow was done before.
    """
    while command.poll() is None:
        with suppress(psutil.NoSuchProcess):
            if kind == "group":
                os.killpg(command.pid, signal.SIGKILL)
            elif kind in PART_OF:
                (process, *_) = [p for p in at_work(repo) if PART_OF[kind] in " ".join(p.cmdline())] or [None]
                if process is None:
                    time.sleep(0.1)
                    continue
                process.kill()
                if kind == "job":  # Snakemake would do what else it can, and fail
                    command.terminate()
            else:
                command.send_signal(signal.Signals[kind])
            return True
    return False


def check(repo: Path, done: Path) -> None:
    """The results are those of the undisturbed run, and there is nothing else."""
    run = relight(repo, "run", *WORDS)
    assert run.returncode == 0, run.stdout
    assert hashes(repo) == hashes(done) and names(repo) == names(done)
    check_mlflow(repo)


def test_killed_anywhere_it_ends_in_the_same_bytes(done, tmp_path):
    """Killed again and again, each time when some more files are there, on one core and on two, in another folder.

    Whenever it is done, it begins anew, with nothing.
    """
    for number in (signal.SIGINT, signal.SIGHUP):  # which the background jobs of a shell ignore, and nohup
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    repo, rng, killed = copy(tmp_path / "0"), random.Random(KILLS), 0
    total = len(outputs(done))
    while killed < KILLS:
        command = [sys.executable, "-m", "relight.cli", "run", *WORDS, "--cores", str(1 + killed % 2)]
        streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        flow = start(repo, command, start_new_session=True, **streams)
        # The moment is one of progress, so that a slow machine is killed in all stages, too.
        there = len(outputs(repo))
        goal = min(total - 1, there + rng.randint(0, max(1, 2 * (total - there) // (KILLS - killed))))
        while len(outputs(repo)) < goal and flow.poll() is None:
            time.sleep(0.2)
        time.sleep(rng.uniform(0, 2))
        kind = KINDS[killed % len(KINDS)]
        if kill(kind, flow, repo):
            killed += 1
            flow.wait()
            print(f"kill {killed}: {kind} with {len(outputs(repo))} of {total} files", flush=True)
        else:
            assert flow.returncode == 0, f"it failed by itself after kill {killed}"
        _, alive = psutil.wait_procs(at_work(repo), timeout=300)
        assert not alive, f"after {kind}, kill {killed}: something works on"
        if flow.returncode == 0:  # it was done before it was killed: begin anew
            check(repo, done)
            shutil.rmtree(repo)
            repo = copy(tmp_path / str(killed))  # another path: MLflow keeps databases open by their addresses
    check(repo, done)
