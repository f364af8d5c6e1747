"""What several files of tests share: one workflow that ran through."""

import fcntl
import os
import shutil
from pathlib import Path

import pytest
from repo import WORDS, copy, relight


@pytest.fixture(scope="session")
def done(tmp_path_factory) -> Path:
    """A repository in which the workflow ran through, undisturbed; tests read it, and change nothing in it.

    It is made once for all processes of pytest-xdist: the first that asks for it makes it, and others wait.
    """
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    folder = base / "undisturbed"
    with open(base / "undisturbed.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "whole").exists():
            shutil.rmtree(folder, ignore_errors=True)
            run = relight(copy(folder), "run", *WORDS)
            assert run.returncode == 0, run.stdout
            (folder / "whole").touch()
    return folder / "repo"
