"""Where memory is short the system kills a job: the workflow says so in a line, and no part of a file is left."""

import os
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from repo import OUT, WORDS, copy, output

LIMIT = 300 << 20  # bytes: enough for Snakemake, too little for a job beside it


@pytest.fixture
def small_memory():
    """The file of a control group's processes, which together get LIMIT bytes and no swap."""
    root = Path("/sys/fs/cgroup")
    first = (root / "memory").is_dir()  # version 1 has a tree for each resource
    group = (root / "memory" if first else root) / f"relight-test-{os.getpid()}"
    try:
        group.mkdir()
        (group / ("memory.limit_in_bytes" if first else "memory.max")).write_text(str(LIMIT))
    except OSError:
        with suppress(OSError):
            group.rmdir()
        pytest.skip("no control groups for memory here")
    with suppress(OSError):
        (group / ("memory.swappiness" if first else "memory.swap.max")).write_text("0")
    yield group / "cgroup.procs"
    group.rmdir()


@pytest.mark.slow
def test_a_job_is_killed_for_memory(small_memory, tmp_path):
    repo = copy(tmp_path)
    inside = ["sh", "-c", f'echo $$ > {small_memory} && exec "$@"', "sh"]
    target = f"{OUT}/figures/g0000-g0009"
    run = output(repo, [*inside, sys.executable, "-m", "relight.cli", "run", *WORDS, "--target", target])
    assert run.returncode == 1
    assert "figure.py' died with <Signals.SIGKILL" in run.stdout, run.stdout
    assert not list((repo / OUT).glob("figures/*"))
