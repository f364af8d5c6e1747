"""The workflow's own progress: one line with counts and the time left, and errors."""

import logging

import pytest
import snakemake_logger_plugin_relight as plugin
from snakemake_interface_logger_plugins.common import LogEvent

from relight.progress import duration


@pytest.fixture
def handler(monkeypatch, tmp_path):
    """A handler on two cores whose clock is set by the test, in a folder of its own."""
    now = [0.0]
    monkeypatch.setattr(plugin, "COSTS", tmp_path / "costs.json")
    monkeypatch.setattr(plugin.time, "monotonic", lambda: now[0])
    made = plugin.LogHandler(None, None)
    made.cores, made.now = 2, now
    return made


def tell(handler, event=None, message="", level=logging.INFO, **fields):
    record = logging.LogRecord("snakemake", level, "", 0, message, None, None)
    record.__dict__.update(event=event, **fields)
    handler.emit(record)


def start(handler, job, rule):
    tell(handler, LogEvent.JOB_INFO, jobid=job, rule_name=rule)
    tell(handler, LogEvent.JOB_STARTED, jobs=[job])


def test_counts_and_time_left(handler, capsys):
    tell(handler, LogEvent.RUN_INFO, stats={"figure": 4, "train": 1, "settings": 9, "total": 14})
    for job in range(3):
        start(handler, job, "figure")
        handler.now[0] += 20
        tell(handler, LogEvent.JOB_FINISHED, job_id=job)
    slower = 20 / plugin.DEMO["figure"]  # how much this machine is beside the one of the table
    train = slower * plugin.DEMO["train"]
    assert capsys.readouterr().err.splitlines() == [
        f"{share}%: figure {done}/4; roughly {duration((20 * (4 - done) + train) / 2)} left"
        for share, done in ((20, 1), (40, 2), (60, 3))
    ]
    start(handler, 3, "train")
    handler.now[0] += 100
    tell(handler, LogEvent.JOB_FINISHED, job_id=3)
    assert capsys.readouterr().err == "80%: figure 3/4; about 10 s left\n"
    tell(handler, LogEvent.PROGRESS, done=5, total=5)
    again = plugin.LogHandler(None, None)
    again.cores = 1
    tell(again, LogEvent.RUN_INFO, stats={"figure": 1, "train": 2})
    assert again.left() == "about 3 min 40 s left", "what jobs cost in the run before"


def test_lines_are_far_apart(handler, capsys):
    tell(handler, LogEvent.RUN_INFO, stats={"clean": 50})
    for job in range(50):
        start(handler, job, "clean")
        handler.now[0] += 1
        tell(handler, LogEvent.JOB_FINISHED, job_id=job)
    assert len(capsys.readouterr().err.splitlines()) == 4


def test_errors_are_told_and_chatter_is_not(handler, capsys):
    tell(handler, message="Select jobs to execute...")
    tell(handler, LogEvent.JOB_ERROR, level=logging.ERROR, jobid=1, rule_name="bake", log=["a.log"])
    tell(handler, LogEvent.ERROR, "No rule to produce x", logging.ERROR, exception="MissingRuleException")
    tell(handler, LogEvent.PROGRESS, done=1, total=1)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["bake failed; its log: a.log", "No rule to produce x", "done in 0 s"]
