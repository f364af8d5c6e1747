"""Utilities for processes: cores, output of git, and termination together with the parent process."""

import ctypes
import io
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path

PR_SET_PDEATHSIG = 1  # prctl(2)
LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


def count_cores() -> int:
    """Returns the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def git(folder: Path, *words: str) -> str:
    """Returns the output of a git command, `words`, in a folder, stripped; empty without git or a repository."""
    try:
        return subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True).stdout.strip()
    except OSError:
        return ""


def has_semaphores() -> bool:
    """Returns whether processes can share a queue, which needs semaphores.

    On Linux these are files in /dev/shm, which is missing or read-only in some containers.
    """
    import multiprocessing

    try:
        multiprocessing.get_context("spawn").Lock()
    except (ImportError, OSError):
        return False
    return True


@contextmanager
def without_messages() -> Iterator[None]:
    """Suppresses what libraries print inside the `with`: native code to stderr, and Python to stdout."""
    null_device, saved_stderr = os.open(os.devnull, os.O_WRONLY), None
    try:
        with suppress(OSError):  # the process may have closed stderr
            saved_stderr = os.dup(2)
            os.dup2(null_device, 2)
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        if saved_stderr is not None:
            os.dup2(saved_stderr, 2)
            os.close(saved_stderr)
        os.close(null_device)


def end_with_parent(parent: int) -> None:
    """Makes Linux kill this process as soon as its parent ends.

    Args:
        parent: process number of the parent, which may have ended already.
    """
    if LIBC:
        LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent has already ended
        os._exit(1)
