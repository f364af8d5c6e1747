"""Paths are checked before the work, errors of the file system are one sentence, and writes are atomic."""

import os
import resource
import signal
import subprocess
import sys

import pytest

from relight.core.errors import UserError
from relight.core.files import atomic_folder, atomic_write, writable_file, writable_folder, write_text


def test_a_folder_that_can_be_made_is_left_unmade_and_that_of_a_file_must_be_there(tmp_path):
    assert writable_folder(tmp_path / "a/b/c", "--out") == tmp_path / "a/b/c"
    assert writable_file(tmp_path / "a.html", "page") == tmp_path / "a.html"
    for path, says in ((tmp_path / "no" / "a.html", "there is no folder"), (tmp_path, "is a folder")):
        with pytest.raises(UserError, match=says):
            writable_file(path, "page")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "is").mkdir()
    writable_folder(tmp_path / "is", "--out")
    assert list((tmp_path / "is").iterdir()) == []


def test_what_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    refused = {"file": "is a file: give a folder", "file/sub": "nothing can be written there \\(not a directory\\)"}
    refused["/proc/relight"] = "nothing can be written there"
    if os.getuid():  # root may write anywhere
        (tmp_path / "locked").mkdir(mode=0o555)
        refused["locked/sub"] = "permission denied"
    for path, says in refused.items():
        with pytest.raises(UserError, match=says) as error:
            writable_folder(tmp_path / path, "--out")
        assert "\n" not in str(error.value) and "--out" in str(error.value)
    with pytest.raises(UserError, match=r"up to 1000000000000 MB are needed, \d+ MB are free"):
        writable_folder(tmp_path / "large", "--out", 10**18)
    assert [path.name for path in tmp_path.iterdir() if path.name != "locked"] == ["file"]


def test_nothing_is_written_below_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    reasons = {"file/a.json": "file is a file", "file/sub/a.json": "not a directory", 300 * "a": "too long"}
    for name, says in reasons.items():
        with pytest.raises(UserError, match=f"{name} cannot be written: .*{says}"):
            write_text(tmp_path / name, "")


def test_a_full_disk_is_said_and_leaves_the_old_file(tmp_path):
    """A limit on the size of files stands for a full disk."""
    (tmp_path / "a.bin").write_bytes(b"old")
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, usual[1]))
    try:
        for block, name in ((atomic_write, "a.bin"), (atomic_folder, "site")):
            refused = pytest.raises(UserError, match=f"{name} cannot be written: file too large")
            with refused, block(tmp_path / name) as out:
                (out / "in" if out.is_dir() else out).write_bytes(bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
        signal.signal(signal.SIGXFSZ, handler)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"old"]
    with pytest.raises(OSError), atomic_write(tmp_path / "b.bin"):
        raise OSError("something else")  # an error of the program stays one


# A writer that is killed in the middle of its block, by a signal that leaves no time to tidy up.
KILLED = """
import os, signal
from relight.core.files import {block}
with {block}({path!r}) as temporary:
    os.kill(os.getpid(), signal.SIGKILL)
"""


def kill_a_writer(block, path):
    run = subprocess.run([sys.executable, "-c", KILLED.format(block=block.__name__, path=str(path))])
    assert run.returncode == -9


@pytest.mark.parametrize("name", ["a.txt", "odd [name]?*.txt"])
def test_a_killed_writers_file_goes_with_the_next_write(tmp_path, name):
    path, other = tmp_path / name, tmp_path / "b.txt"
    for killed in (path, other):
        kill_a_writer(atomic_write, killed)
    assert len(list(tmp_path.iterdir())) == 2
    with atomic_write(path) as temporary:
        temporary.write_text("whole")
    assert path.read_text() == "whole"
    left = [found.name for found in tmp_path.iterdir() if found != path]
    assert len(left) == 1 and left[0].startswith(".b."), "another file's temporary is not ours to remove"


def test_a_killed_writers_folder_goes_with_the_next_write(tmp_path):
    path = tmp_path / "folder"
    kill_a_writer(atomic_folder, path)
    with atomic_folder(path) as temporary:
        (temporary / "in").write_text("whole")
    assert [found.name for found in tmp_path.iterdir()] == ["folder"]
    (tmp_path / "link").symlink_to(path)
    with atomic_folder(tmp_path / "link") as temporary:
        (temporary / "in").write_text("through a link")
    assert (tmp_path / "link").is_symlink() and (path / "in").read_text() == "through a link"


@pytest.mark.parametrize(("block", "name"), [(atomic_write, "a.txt"), (atomic_folder, "folder")])
def test_a_living_writers_temporary_stays(tmp_path, block, name):
    with block(tmp_path / name) as first, block(tmp_path / name) as second:
        assert first.exists() and second.exists() and first != second
