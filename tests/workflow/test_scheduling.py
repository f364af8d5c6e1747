import threading
import time

from snakemake.scheduling.job_scheduler import JobScheduler

from relight.scheduling import calm


class Scheduler:
    """What the timers touch of Snakemake's scheduler."""

    def __init__(self):
        self._open_jobs = threading.Semaphore(0)

    def wakes(self, seconds):
        time.sleep(seconds)
        return self._open_jobs._value


def test_many_rounds_keep_one_timer(monkeypatch):
    raw = JobScheduler._schedule_reevalutation
    monkeypatch.setattr(JobScheduler, "_schedule_reevalutation", raw)
    calm()
    calm()  # a Snakefile may be read more than once in a process
    scheduler = Scheduler()
    for _ in range(20):
        JobScheduler._schedule_reevalutation(scheduler, 0.05)
    assert scheduler.wakes(0.4) == 1
    JobScheduler._schedule_reevalutation(scheduler, 0.05)
    assert scheduler.wakes(0.4) == 2, "after it has fired, the next round starts a timer again"
