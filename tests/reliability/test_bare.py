"""Machines that lack what most have: a container without /sys, whose /dev/shm can only be read."""

import os
import subprocess
import sys

import pytest
from namespaces import mounted, namespaced

BARE = """
import os
from relight.core.processes import has_semaphores
assert not os.listdir("/sys") and not has_semaphores()
from relight import cli
from relight.lights.chain import parallel_map
words = ["a" * count for count in range(100)]
assert list(parallel_map(len, words)) == list(range(100))
cli.main()
"""


@pytest.mark.slow
@pytest.mark.skipif(not namespaced(), reason="no mount namespaces here")
def test_without_sys_and_shared_memory(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    command = [*mounted("none /sys", "-o ro none /dev/shm"), sys.executable, "-c", BARE]
    words = ["bake", "a.obj", "--as-is", "--size", "64", "--out", "a.exr"]
    done = subprocess.run([*command, *words], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.exr").stat().st_size > 1000


def test_figures_are_made_in_this_process_where_others_cannot_share(tmp_path, monkeypatch):
    from relight.figures import commands

    made = []
    monkeypatch.setattr("relight.core.processes.has_semaphores", lambda: False)
    monkeypatch.setattr(commands, "make_one", lambda task: made.append((os.getpid(), task[0])))
    monkeypatch.setattr(commands, "write_table", lambda folder: None)
    commands.figures(seeds="3-5", out=tmp_path, jobs=2)
    assert made == [(os.getpid(), seed) for seed in (3, 4, 5)]
