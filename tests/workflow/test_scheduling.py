"""The correction of Snakemake's scheduler holds for the locked version, and for no version that nobody measured."""

import threading
import time

import pytest
import snakemake
from snakemake.scheduling.job_scheduler import JobScheduler

from relight.scheduling import PATCHED, limit_scheduler_timers


class Scheduler:
    """The part of Snakemake's scheduler that its timers use."""

    def __init__(self):
        self._open_jobs = threading.Semaphore(0)

    def wakes(self, seconds):
        time.sleep(seconds)
        return self._open_jobs._value


@pytest.fixture
def unpatched():
    """The method of Snakemake's class, which is as it was during the test and afterwards."""
    original = JobScheduler._schedule_reevalutation
    yield original
    JobScheduler._schedule_reevalutation = original
    if hasattr(JobScheduler, "relight_timer"):
        del JobScheduler.relight_timer


def test_many_rounds_keep_one_timer(unpatched):
    limit_scheduler_timers()
    limit_scheduler_timers()  # a Snakefile may be read more than once in a process
    assert JobScheduler._schedule_reevalutation is not unpatched, "the locked version is one of PATCHED"
    scheduler = Scheduler()
    for _ in range(20):
        JobScheduler._schedule_reevalutation(scheduler, 0.05)
    assert scheduler.wakes(0.4) == 1
    JobScheduler._schedule_reevalutation(scheduler, 0.05)
    assert scheduler.wakes(0.4) == 2, "after it has fired, the next round starts a timer again"


def test_other_versions_are_left_alone(unpatched, monkeypatch):
    monkeypatch.setattr(snakemake, "__version__", "9.99.0")
    assert not "9.99.0".startswith(PATCHED)
    limit_scheduler_timers()
    assert JobScheduler._schedule_reevalutation is unpatched
