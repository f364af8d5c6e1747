"""However `relight run` ends, Snakemake and its jobs end with it; and what a job does with errors and output."""

import re
import signal
import subprocess
import sys

import psutil
import pytest
from repo import start

from relight.settings import ROOT

PATIENCE = 120  # seconds, which a slow machine has too; less than a stand-in sleeps

# Stand-ins for the workflow. Snakemake goes on to the next job when one fails and after TERM; after INT it waits for
# the job at work. A job is a process that a shell started.
JOB = """
import sys, time
from relight.lab.job import end_with
end_with(int(sys.argv[1]))
print("here", flush=True)
time.sleep(300)
"""
SNAKEMAKE = f"""
import os, shlex, signal, subprocess, sys
os.fstat(int(sys.argv[1]))  # the lock
stopped = []
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, lambda *_: None)
if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
    signal.signal(signal.SIGINT, lambda *_: stopped.append(True))
job = shlex.join([sys.executable, "-c", {JOB!r}, str(os.getpid())])
while not stopped:
    subprocess.call(["bash", "-c", "set -euo pipefail; " + job + "; true"])
sys.exit(1)
"""
RUN = f"""
import os, sys
from relight.lab.run import snakemake
lock = os.open("/", os.O_RDONLY)
sys.exit(snakemake([sys.executable, "-c", {SNAKEMAKE!r}, str(lock)], [lock]))
"""


@pytest.fixture
def run(request):
    """A run whose job is at work, and all its processes; what a failing test leaves is killed.

    It ignores INT, as what a script starts in the background does, unless it is tested with that; it does not ignore
    HUP, even if these tests were started with nohup.
    """
    background = "SIGINT" not in request.node.name
    inherited = {signal.SIGINT: signal.SIG_IGN if background else signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL}
    before = {number: signal.signal(number, how) for number, how in inherited.items()}
    job = start(ROOT, [sys.executable, "-c", RUN], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    for number, how in before.items():
        signal.signal(number, how)
    assert job.stdout.readline() == "here\n"
    processes = [psutil.Process(job.pid), *psutil.Process(job.pid).children(recursive=True)]
    assert len(processes) >= 4
    yield job, processes
    for process in processes:
        if process.is_running():
            process.kill()
    job.wait()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGHUP", "SIGINT", "SIGKILL"])
def test_nothing_is_left_when_the_run_is_ended(run, name):
    job, processes = run
    job.send_signal(getattr(signal, name))
    assert (
        job.wait(timeout=PATIENCE) == (-9 if name == "SIGKILL" else 130)
        and not psutil.wait_procs(processes[1:], timeout=PATIENCE)[1]
    )
    assert not job.stderr.read(), "no traceback"


@pytest.mark.slow
def test_the_jobs_end_with_snakemake(run):
    job, processes = run
    processes[1].kill()
    assert job.wait(timeout=PATIENCE) != 0 and not psutil.wait_procs(processes[1:], timeout=PATIENCE)[1]


@pytest.mark.slow
def test_a_job_whose_snakemake_is_gone_does_not_start():
    gone = subprocess.Popen(["true"])
    gone.wait()
    command = [sys.executable, "-c", JOB, str(gone.pid)]
    job = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert job.returncode == 1 and "has ended" in job.stderr and not job.stdout


SCRIPT = """
import os, sys
from types import SimpleNamespace
from relight.core.errors import UserError
from relight.lab.job import job
process = SimpleNamespace(
    config={"job": {"process": os.getppid()}}, rule="bake", wildcards=["a b", ""], log=["x.log"],
    output=["results/x/maps"], params=dict(), input=[],
)
with job(process):
    print("one")
    os.system("echo two >&2")
    {}
print("after")
"""


@pytest.mark.slow
@pytest.mark.parametrize(("last", "code", "told"), [
    ("", 0, ""),
    ("raise UserError('it is too wide')", 1, "it is too wide\n"),
    ("raise MemoryError", 1, "there is not enough memory"),
    ("raise KeyboardInterrupt", 130, ""),
    ("1 / 0", 1, "ZeroDivisionError: division by zero\n"),
])  # fmt: skip
def test_what_a_job_prints_is_in_its_log_and_behind_its_name_on_the_console(tmp_path, last, code, told):
    (tmp_path / "bake.py").write_text(SCRIPT.replace("{}", last))
    job = subprocess.run([sys.executable, "bake.py"], cwd=tmp_path, capture_output=True, text=True)
    assert job.returncode == code
    if code == 130:
        return
    first, *lines = (tmp_path / "x.log").read_text().splitlines(keepends=True)
    assert first.startswith("# ") and "numpy" in first and {"one\n", "two\n"} <= set(lines)
    assert code or re.fullmatch(r"# [\d.]+ s of CPU, [\d.]+ GB at most\n", lines.pop())
    assert told in "".join(lines) and ("Traceback" in "".join(lines)) == ("/" in last)
    console = [line for line in job.stderr.splitlines() + job.stdout.splitlines() if line != "after"]
    assert console == [f"bake a b: {line.rstrip()}" for line in lines]
    assert ("after" in job.stdout.splitlines() + job.stderr.splitlines()) == (code == 0)
    if code == 0:  # what is kept keeps its log
        made = (tmp_path / "x.log").read_text()
        subprocess.run([sys.executable, "bake.py"], cwd=tmp_path, capture_output=True)
        kept = (tmp_path / "x.log").read_text()
        assert kept.startswith(made) and kept.endswith("kept: it was made with these inputs, settings and code\n")
