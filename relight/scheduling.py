"""A mend of Snakemake's scheduler, for workflows of a thousand short jobs."""

import threading


def calm() -> None:
    """Keeps one timer of Snakemake's job scheduler pending at a time; without a version of it that needs this, nothing.

    Snakemake 9.27 starts a timer that wakes the scheduler at the end of each round, also of the rounds that such timers
    started; every finished job adds one more endless chain. After 100 jobs it looks over all waiting jobs a hundred
    times a second, and one core is lost to that (snakemake/snakemake#3744 tells of the same chains).
    """
    from snakemake.scheduling.job_scheduler import JobScheduler

    wake_later = getattr(JobScheduler, "_schedule_reevalutation", None)
    if wake_later is None or hasattr(wake_later, "calm"):
        return
    pending = threading.Event()

    def wake_once(self, delay: float) -> None:
        if pending.is_set():
            return
        pending.set()

        def wake() -> None:
            pending.clear()
            self._open_jobs.release()

        threading.Timer(delay, wake).start()

    wake_once.calm = True
    JobScheduler._schedule_reevalutation = wake_once
