"""A patch of Snakemake's scheduler for workflows with many short jobs."""

import threading
from typing import Any

PATCHED = ("9.27.",)  # versions with the problem; others are not patched


def limit_scheduler_timers() -> None:
    """Limits Snakemake's scheduler to one pending timer (snakemake/snakemake#3744), in the versions PATCHED.

    Without the patch, each finished job adds a timer that repeats forever: after 100 jobs, the scheduler examines all
    jobs a hundred times a second, which takes a core.
    """
    import snakemake
    from snakemake.scheduling.job_scheduler import JobScheduler

    if not snakemake.__version__.startswith(PATCHED) or hasattr(JobScheduler, "relight_timer"):
        return
    JobScheduler.relight_timer = pending = threading.Event()

    def wake_once(self: Any, delay: float) -> None:
        """Stands for the scheduler's method, which makes it examine all jobs in `delay` seconds."""
        if pending.is_set():
            return
        pending.set()

        def wake() -> None:
            pending.clear()
            self._open_jobs.release()

        threading.Timer(delay, wake).start()

    JobScheduler._schedule_reevalutation = wake_once  # Snakemake's own spelling
