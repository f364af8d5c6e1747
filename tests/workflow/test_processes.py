"""However `relight run` ends, Snakemake and its jobs end with it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from repo import start

from relight.config import ROOT

pytestmark = pytest.mark.slow

PATIENCE = 120  # seconds, which a slow machine has too; less than a stand-in sleeps

# Stand-ins for the workflow. Snakemake goes on to the next job when one fails and after TERM; after INT it waits for
# the job at work. A job is a stage that a shell started, whose output goes on through a pipe.
STAGE = """
import time
from relight.processes import end_with_snakemake
end_with_snakemake()
print("here", flush=True)
time.sleep(300)
"""
SNAKEMAKE = f"""
import os, shlex, signal, subprocess, sys
from relight.processes import STARTED_BY
os.environ[STARTED_BY] = str(os.getpid())
stopped = []
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, lambda *_: None)
if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
    signal.signal(signal.SIGINT, lambda *_: stopped.append(True))
stage = shlex.join([sys.executable, "-c", {STAGE!r}])
while not stopped:
    subprocess.call(["bash", "-c", "set -o pipefail; " + stage + " 2>&1 | tee"])
sys.exit(1)
"""
RUN = f"""
import sys
from relight.run import snakemake
sys.exit(snakemake([sys.executable, "-c", {SNAKEMAKE!r}]))
"""
TEST = f"""
import sys
from pathlib import Path
from repo import start
start(Path({str(ROOT)!r}), [sys.executable, "-c", {RUN!r}]).wait()
"""


def family(process: subprocess.Popen) -> list[psutil.Process]:
    return [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]


@pytest.fixture
def run(request):
    """A run whose job is at work, and all its processes; what a failing test leaves is killed.

    It ignores INT, as what a script starts in the background does, unless it is tested with that; it does not ignore
    HUP, even if these tests were started with nohup.
    """
    background = "SIGINT" not in request.node.name
    inherited = {signal.SIGINT: signal.SIG_IGN if background else signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL}
    before = {number: signal.signal(number, how) for number, how in inherited.items()}
    job = start(ROOT, [sys.executable, "-c", RUN], stdout=subprocess.PIPE, text=True)
    for number, how in before.items():
        signal.signal(number, how)
    assert job.stdout.readline() == "here\n"
    processes = family(job)
    assert len(processes) >= 5
    yield job, processes
    end(processes)
    job.wait()


def end(processes: list[psutil.Process]) -> None:
    """Kills what a test that failed leaves at work."""
    for process in processes:
        if process.is_running():
            process.kill()


def working(processes: list[psutil.Process]) -> list[psutil.Process]:
    return psutil.wait_procs(processes, timeout=PATIENCE)[1]


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT", "SIGKILL"])
def test_nothing_is_left_when_the_run_is_ended(run, name):
    job, processes = run
    job.send_signal(getattr(signal, name))
    job.wait(timeout=PATIENCE)
    assert not working(processes[1:])


def test_the_jobs_end_with_snakemake(run):
    job, processes = run
    processes[1].kill()
    assert job.wait(timeout=PATIENCE) != 0
    assert not working(processes[1:])


def test_a_run_ends_with_the_test_that_started_it():
    paths = os.pathsep.join([str(ROOT), str(Path(__file__).parent)])
    environment = {**os.environ, "PYTHONPATH": paths}
    test = subprocess.Popen([sys.executable, "-c", TEST], env=environment, stdout=subprocess.PIPE, text=True)
    assert test.stdout.readline() == "here\n"
    processes = family(test)
    assert len(processes) >= 6
    test.kill()
    test.wait()
    left = working(processes[1:])
    end(left)
    assert not left


def test_a_run_that_is_stopped_stops_its_jobs(run):
    job, processes = run
    job.send_signal(signal.SIGTSTP)
    states = set()
    for _ in range(10 * PATIENCE):
        states = {process.status() for process in processes}
        if states == {psutil.STATUS_STOPPED}:
            break
        time.sleep(0.1)
    assert states == {psutil.STATUS_STOPPED}
    job.send_signal(signal.SIGCONT)
    job.send_signal(signal.SIGTERM)
    job.wait(timeout=PATIENCE)
    assert not working(processes[1:])


def test_a_job_whose_snakemake_is_gone_does_not_start():
    gone = subprocess.Popen(["true"])
    gone.wait()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "RELIGHT_SNAKEMAKE": str(gone.pid)}
    command = [sys.executable, "-c", STAGE]
    stage = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert stage.returncode == 1 and "has ended" in stage.stderr and not stage.stdout
