import subprocess
import sys

import pytest

from relight.files import whole, whole_folder

# A writer that is killed in the middle of its block, by a signal that leaves no time to tidy up.
KILLED = """
import os, signal
from relight.files import {block}
with {block}({path!r}) as temporary:
    os.kill(os.getpid(), signal.SIGKILL)
"""


def kill_a_writer(block, path):
    run = subprocess.run([sys.executable, "-c", KILLED.format(block=block.__name__, path=str(path))])
    assert run.returncode == -9


@pytest.mark.parametrize("name", ["a.txt", "odd [name]?*.txt"])
def test_a_killed_writers_file_goes_with_the_next_write(tmp_path, name):
    path, other = tmp_path / name, tmp_path / "b.txt"
    kill_a_writer(whole, path)
    kill_a_writer(whole, other)
    assert len(list(tmp_path.iterdir())) == 2
    with whole(path) as temporary:
        temporary.write_text("whole")
    assert path.read_text() == "whole"
    left = [found.name for found in tmp_path.iterdir() if found != path]
    assert len(left) == 1 and left[0].startswith(".b."), "another file's temporary is not ours to remove"


def test_a_killed_writers_folder_goes_with_the_next_write(tmp_path):
    path = tmp_path / "folder"
    kill_a_writer(whole_folder, path)
    with whole_folder(path) as temporary:
        (temporary / "in").write_text("whole")
    assert [found.name for found in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize(("block", "name"), [(whole, "a.txt"), (whole_folder, "folder")])
def test_a_living_writers_temporary_stays(tmp_path, block, name):
    with block(tmp_path / name) as first, block(tmp_path / name) as second:
        assert first.exists() and second.exists() and first != second


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), whole(path) as temporary:
        temporary.write_text("new")
        raise RuntimeError
    assert path.read_text() == "old" and [found.name for found in tmp_path.iterdir()] == ["a.txt"]
