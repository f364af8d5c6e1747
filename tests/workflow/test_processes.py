"""However `relight run` ends, Snakemake and its jobs end with it."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from relight.config import ROOT

# Stand-ins for the workflow. Snakemake waits for its jobs when it gets INT and goes on after TERM, as the real one
# does. A job is a stage that a shell started, whose output goes on through a pipe.
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
for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
    signal.signal(number, lambda *_: None)
stage = [sys.executable, "-c", {STAGE!r}]
sys.exit(subprocess.call(["bash", "-c", "set -o pipefail; " + shlex.join(stage) + " 2>&1 | tee"]))
"""
RUN = f"""
import sys
from relight.run import snakemake
sys.exit(snakemake([sys.executable, "-c", {SNAKEMAKE!r}]))
"""


def family(process: subprocess.Popen) -> list[psutil.Process]:
    return [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]


@pytest.fixture
def run():
    """A run whose job is at work, and all its processes; what a failing test leaves is killed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    job = subprocess.Popen([sys.executable, "-c", RUN], env=environment, stdout=subprocess.PIPE, text=True)
    assert job.stdout.readline() == "here\n"
    processes = family(job)
    assert len(processes) >= 5
    yield job, processes
    for process in processes:
        if process.is_running():
            process.kill()
    job.wait()


def working(processes: list[psutil.Process]) -> list[psutil.Process]:
    return psutil.wait_procs(processes, timeout=20)[1]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGKILL])
def test_nothing_is_left_when_the_run_is_ended(run, number):
    job, processes = run
    job.send_signal(number)
    job.wait(timeout=20)
    assert not working(processes[1:])


def test_the_jobs_end_with_snakemake(run):
    job, processes = run
    processes[1].kill()
    assert job.wait(timeout=20) != 0
    assert not working(processes[1:])


def test_a_run_that_is_stopped_stops_its_jobs(run):
    job, processes = run
    job.send_signal(signal.SIGTSTP)
    states = set()
    for _ in range(100):
        states = {process.status() for process in processes}
        if states == {psutil.STATUS_STOPPED}:
            break
        time.sleep(0.1)
    assert states == {psutil.STATUS_STOPPED}
    job.send_signal(signal.SIGCONT)
    job.send_signal(signal.SIGTERM)
    job.wait(timeout=20)
    assert not working(processes[1:])


def test_a_job_whose_snakemake_is_gone_does_not_start():
    gone = subprocess.Popen(["true"])
    gone.wait()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "RELIGHT_SNAKEMAKE": str(gone.pid)}
    stage = subprocess.run([sys.executable, "-c", STAGE], env=environment, capture_output=True, text=True, timeout=60)
    assert stage.returncode == 1 and "has ended" in stage.stderr and not stage.stdout
