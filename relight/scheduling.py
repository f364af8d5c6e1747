"""A correction of Snakemake's scheduler, for workflows of a thousand short jobs."""

import threading
from typing import Any

PATCHED = ("9.27.",)  # the versions that were read and measured; others are left as they are


def limit_scheduler_timers() -> None:
    """Keeps at most one timer of Snakemake's scheduler pending (snakemake/snakemake#3744), in the versions PATCHED.

    Each round of the scheduler starts a timer that starts a round, and each finished job adds one such chain: after 100
    jobs the scheduler reviews all jobs a hundred times a second, which takes a core.
    """
    import snakemake
    from snakemake.scheduling.job_scheduler import JobScheduler

    if not snakemake.__version__.startswith(PATCHED) or hasattr(JobScheduler, "relight_timer"):
        return
    JobScheduler.relight_timer = pending = threading.Event()

    def wake_once(self: Any, delay: float) -> None:
        if pending.is_set():
            return
        pending.set()

        def wake() -> None:
            pending.clear()
            self._open_jobs.release()

        threading.Timer(delay, wake).start()

    JobScheduler._schedule_reevalutation = wake_once  # sic
