"""The workflow's own progress: one line with counts and the time left, and errors."""

import logging
from types import SimpleNamespace

import pytest
import snakemake_logger_plugin_relight as plugin
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_logger_plugin_relight import costs


@pytest.fixture
def handler(monkeypatch):
    """A handler on two cores whose clock is set by the test."""
    now = [0.0]
    monkeypatch.setattr(plugin.time, "monotonic", lambda: now[0])
    made = plugin.LogHandler(SimpleNamespace(dryrun=False), plugin.LogHandlerSettings())
    made.costs.before = {"figure": 10.0, "train": 100.0}
    made.cores, made.now = 2, now
    return made


def tell(handler, event=None, message="", level=logging.INFO, **fields):
    record = logging.LogRecord("snakemake", level, "", 0, message, None, None)
    record.__dict__.update(event=event, **fields)
    handler.emit(record)


def start(handler, job, rule, benchmark=None):
    tell(handler, LogEvent.JOB_INFO, jobid=job, rule_name=rule, benchmark=benchmark)
    tell(handler, LogEvent.JOB_STARTED, jobs=[job])


def test_counts_and_time_left(handler, capsys):
    """Four figures at 10 s and two trainings of 100 s that need them; figures take twice as long as was thought."""
    links = [{"sourcerule": "figure", "targetrule": "train"}, {"sourcerule": "settings", "targetrule": "figure"}]
    tell(handler, LogEvent.RULEGRAPH, rulegraph={"nodes": [], "links": links})
    tell(handler, LogEvent.RUN_INFO, stats={"figure": 4, "train": 2, "settings": 9, "total": 15})
    start(handler, 0, "figure")
    start(handler, 1, "figure")
    handler.now[0] += 20
    tell(handler, LogEvent.JOB_FINISHED, job_id=0)
    start(handler, 2, "figure")
    handler.now[0] += 15
    tell(handler, LogEvent.JOB_FINISHED, job_id=2)
    told = [
        "6 jobs; roughly 2 min 00 s left",  # 2 × 10 s, then 100 s, on two cores
        "17%: figure 1/4; roughly 3 min 42 s left",  # one is due, 2 s more: 2 on two cores, then 200 s
        "33%: figure 2/4; roughly 3 min 13 s left",  # 17.5 s: the third is overdue; and 1.75 × 100 s
    ]
    assert capsys.readouterr().err.splitlines() == told


def test_what_was_never_measured_is_told(handler, capsys):
    tell(handler, LogEvent.RUN_INFO, stats={"figure": 2, "trace": 1})
    for job, rule in enumerate(("figure", "trace", "figure")):
        start(handler, job, rule)
        handler.now[0] += 12
        tell(handler, LogEvent.JOB_FINISHED, job_id=job)
    told = [
        "3 jobs; more than 10 s left (trace not measured yet)",
        "33%: figure 1/2; more than 12 s left (trace not measured yet)",
        "67%: figure 1/2; about 12 s left",
        "100%: figure 2/2; about 0 s left",
    ]
    assert capsys.readouterr().err.splitlines() == told
    handler.total = {"scan": 2}
    assert handler.left() == "time left unknown (scan not measured yet)"
    handler.total = {"scan": 2, "clean": 2, "align": 2, "bake": 2}
    assert handler.left() == "time left unknown (4 of the stages not measured yet)"


def test_costs_are_those_of_the_folder(handler, tmp_path):
    """Of its earlier runs, by rule; one of this run is what Snakemake measured of it, without a cluster's queue."""
    for name, seconds in (("figure/a", 2), ("figure/b", 4), ("evaluate/x/c", 9), ("bake/damaged", "-")):
        file = tmp_path / "benchmark" / f"{name}.tsv"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"s\th:m:s\n{seconds}\t-\n")
    found = costs.Costs(tmp_path)
    assert found.before == {"figure": 3, "evaluate": 9}
    assert costs.Costs(tmp_path / "none").before == costs.Costs().before == {}
    handler.costs = found
    tell(handler, LogEvent.RUN_INFO, stats={"figure": 2, "evaluate": 1})
    start(handler, 0, "figure", str(tmp_path / "benchmark/figure/b.tsv"))
    handler.now[0] += 500
    tell(handler, LogEvent.JOB_FINISHED, job_id=0)
    assert (found["figure"], found["evaluate"]) == (4, 9 * 4 / 3)


def schedule(waiting, cost, needs, running, cores):
    """A slow twin of `makespan`: in steps of a second, each free core takes a job that is ready."""
    waiting, at_work, now = dict(waiting), list(running), 0
    while any(waiting.values()) or at_work:
        for rule in sorted(waiting, key=list(cost).index):
            blocked = any(waiting.get(other) or other in dict(at_work) for other in needs.get(rule, ()))
            while waiting[rule] and not blocked and len(at_work) < cores:
                waiting[rule] -= 1
                at_work.append((rule, cost[rule]))
        now += 1
        at_work = [(rule, seconds - 1) for rule, seconds in at_work if seconds > 1]
    return now


@pytest.mark.parametrize("cores", [1, 2, 3, 9])
def test_the_makespan_is_that_of_a_schedule(cores):
    """figures and lights, then trainings, then their scores, then a report."""
    cost = {"figure": 5, "lights": 7, "train": 20, "evaluate": 6, "report": 3}
    needs = {"train": ["figure", "lights"], "evaluate": ["train"], "report": ["evaluate", "figure"]}
    waiting = {"figure": 4, "lights": 1, "train": 5, "evaluate": 5, "report": 1}
    assert costs.makespan(waiting, cost, needs, [], cores) == schedule(waiting, cost, needs, [], cores)
    waiting |= {"figure": 0, "lights": 0, "train": 1}
    running = [("train", 11), ("train", 2)][:cores]
    assert costs.makespan(waiting, cost, needs, running, cores) == schedule(waiting, cost, needs, running, cores)


def test_lines_are_far_apart(handler, capsys):
    tell(handler, LogEvent.RUN_INFO, stats={"clean": 50})
    for job in range(50):
        start(handler, job, "clean")
        handler.now[0] += 1
        tell(handler, LogEvent.JOB_FINISHED, job_id=job)
    assert len(capsys.readouterr().err.splitlines()) == 1 + 4


def test_errors_are_told_and_chatter_is_not(handler, capsys):
    tell(handler, message="Select jobs to execute...")
    tell(handler, LogEvent.JOB_ERROR, level=logging.ERROR, jobid=1, rule_name="bake", log=["a.log"])
    tell(handler, LogEvent.ERROR, "No rule to produce x", logging.ERROR, exception="MissingRuleException")
    tell(handler, LogEvent.PROGRESS, done=1, total=1)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["bake failed; its log: a.log", "No rule to produce x", "done in 0 s"]


def test_a_job_that_was_killed_is_told_from_one_that_failed(handler, capsys):
    """Snakemake tells first how a command ended, then in the same thread which job it was."""
    for code in (1, 137, 1):
        message = f"CalledProcessError in file x:\nCommand 'y' returned non-zero exit status {code}."
        tell(handler, LogEvent.ERROR, message, logging.ERROR, exception="RuleException")
        tell(handler, LogEvent.JOB_ERROR, level=logging.ERROR, jobid=1, rule_name="bake", log=["a.log"])
    first, second, third = capsys.readouterr().err.splitlines()
    assert first == third == "bake failed; its log: a.log"
    assert second.startswith("bake was killed, as the system does when memory")


def test_dry_run_says_once_what_would_run(handler, capsys):
    handler.common_settings.dryrun = True
    for _ in range(2):
        tell(handler, LogEvent.RUN_INFO, stats={"figure": 4, "train": 1, "settings": 9, "total": 14})
    tell(handler, message="Reasons: (check individual jobs above for details)")
    assert capsys.readouterr().err == "5 jobs would run: figure 4, train 1; roughly 2 min 00 s left\n"
