"""Processes: the cores they may use, what git prints, and an end to those whose starter is gone."""

import ctypes
import os
import select
import signal
import subprocess
import sys
import threading
from pathlib import Path

STARTED_BY = "RELIGHT_SNAKEMAKE"  # in a stage's environment: the process of the Snakemake that it works for
PR_SET_PDEATHSIG = 1  # prctl(2)
LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


def count_cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def git(folder: Path, *words: str) -> str:
    """The output of a git command in a folder; empty where there is no git or no repository."""
    try:
        return subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True).stdout.strip()
    except OSError:
        return ""


def has_semaphores() -> bool:
    """Whether processes can share a queue.

    It needs semaphores. On Linux they are files in /dev/shm, which some containers do not have or only to read.
    """
    import multiprocessing

    try:
        multiprocessing.get_context("spawn").Lock()
    except (ImportError, OSError):
        return False
    return True


def end_with_parent(parent: int) -> None:
    """Called by a child of the process `parent` when it starts: Linux kills it as soon as its parent ends."""
    if LIBC:
        LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before that
        os._exit(1)


def end_with_snakemake() -> None:
    """Ends this process as soon as the Snakemake that it works for has ended, in whatever way.

    The shell of the rule stands between the two and outlives Snakemake, so `end_with_parent` does not reach this far. A
    handle on the process can be waited for instead (pidfd_open(2), Linux).
    """
    if STARTED_BY not in os.environ or not hasattr(os, "pidfd_open"):
        return

    def wait() -> None:
        select.select([handle], [], [])
        os.kill(os.getpid(), signal.SIGTERM)

    try:
        handle = os.pidfd_open(int(os.environ[STARTED_BY]))
    except ProcessLookupError:
        sys.exit("the Snakemake that started this has ended")
    threading.Thread(target=wait, daemon=True).start()
