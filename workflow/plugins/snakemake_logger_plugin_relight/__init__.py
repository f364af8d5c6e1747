"""Snakemake's progress in one line: how far each rule is, and the time left; errors in full, and nothing else."""

import json
import logging
import os
import sys
import time
from collections import Counter, defaultdict
from contextlib import suppress
from pathlib import Path

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from relight.progress import duration

EVERY = 10.0  # seconds between two lines where there is no terminal
COSTS = Path(".snakemake", "relight.costs.json")  # seconds of a job of each rule, from the runs before this one
# Seconds of a job at scale=demo, on one core of the machine that the README speaks of; for rules that have never run.
# What has run says how fast this machine and these settings are beside them.
DEMO = {
    "figure": 8.0,
    "figure_decade": 55.0,
    "scan": 4.0,
    "clean": 2.0,
    "clean_decade": 5.0,
    "align": 1.0,
    "align_decade": 3.0,
    "bake": 6.0,
    "bake_decade": 45.0,
    "pack": 4.0,
    "lights": 45.0,
    "train": 105.0,
    "evaluate": 12.0,
    "baselines": 8.0,
    "plates": 15.0,
    "sheets": 12.0,
    "viewer": 8.0,
    "report": 10.0,
    "tables": 4.0,
    "trace": 60.0,
    "light_transfer": 20.0,
    "path_traced": 20.0,
    "inference_time": 30.0,
}
SHORT = 2.0  # seconds of any other job


class LogHandler(LogHandlerBase):
    """`12%: figure 12/64, bake 8/64; about 4 min left`: rewritten on a terminal, a line now and then in a log."""

    writes_to_stream = True
    writes_to_file = False
    has_filter = True  # else the profile's `quiet` hides the names of the rules, which are counted here
    has_formatter = True
    needs_rulegraph = False

    def __post_init__(self) -> None:
        self.total: dict[str, int] = {}
        self.done: Counter[str] = Counter()
        self.rule: dict[int, str] = {}
        self.since: dict[int, float] = {}
        self.took: dict[str, list[float]] = defaultdict(list)
        self.before: dict[str, float] = {}
        with suppress(OSError, ValueError):
            self.before = json.loads(COSTS.read_text())
        self.cores = os.cpu_count() or 1
        self.start = self.last = time.monotonic()
        self.terminal = sys.stderr.isatty()

    def emit(self, record: logging.LogRecord) -> None:
        event = getattr(record, "event", None)
        if event == LogEvent.RUN_INFO:
            counts = {
                rule: n for rule, n in record.stats.items() if rule not in ("total", "all", "settings", "listing")
            }
            self.total = self.total or counts
        elif event == LogEvent.JOB_INFO:
            self.rule[record.jobid] = record.rule_name
        elif event == LogEvent.JOB_STARTED:
            for job in [record.jobs] if isinstance(record.jobs, int) else record.jobs or ():
                self.since[job] = time.monotonic()
        elif event == LogEvent.JOB_FINISHED:
            self.finished(record.job_id)
        elif event == LogEvent.PROGRESS and record.done == record.total:
            self.remember()
            self.say(f"done in {duration(time.monotonic() - self.start)}", whole=True)
        elif event in (LogEvent.ERROR, LogEvent.JOB_ERROR, LogEvent.GROUP_ERROR) or record.levelno >= logging.ERROR:
            self.failed(record, event)
        elif record.getMessage().startswith("Nothing to be done"):
            self.say(record.getMessage(), whole=True)

    def finished(self, job: int) -> None:
        """Counts a job, and tells where things are when it is time to."""
        rule = self.rule.get(job, "")
        if rule not in self.total:
            return
        self.done[rule] += 1
        self.took[rule].append(time.monotonic() - self.since.get(job, time.monotonic()))
        if self.terminal or time.monotonic() - self.last > EVERY:
            under_way = [rule for rule in self.total if 0 < self.done[rule] < self.total[rule]]
            counts = ", ".join(f"{rule} {self.done[rule]}/{self.total[rule]}" for rule in under_way or [rule])
            share = sum(self.done.values()) / max(1, sum(self.total.values()))
            self.say(f"{share:.0%}: {counts}; {self.left()}")

    def left(self) -> str:
        """The time that the rest takes: each job ahead at what one costs in this run, did before, or where measured."""
        work = sum((n - self.done[rule]) * self.cost(rule) for rule, n in self.total.items())
        guessed = [rule for rule, n in self.total.items() if self.done[rule] < n and not self.known(rule)]
        return f"{'roughly' if guessed else 'about'} {duration(work / self.cores)} left"

    def known(self, rule: str) -> float | None:
        """The seconds of a job of a rule in this run, or else in the last one that had any."""
        took = self.took.get(rule)
        return sum(took) / len(took) if took else self.before.get(rule)

    def cost(self, rule: str) -> float:
        """The seconds of a job of a rule; of one that never ran, its usual ones, times how slow the others were."""
        if (known := self.known(rule)) is not None:
            return known
        seen = [name for name in self.total if self.known(name) is not None and name in DEMO]
        slower = sum(map(self.known, seen)) / sum(DEMO[name] for name in seen) if seen else 1.0
        return slower * DEMO.get(rule, SHORT)

    def remember(self) -> None:
        """Writes down what jobs cost, for the next run."""
        costs = self.before | {rule: round(self.known(rule), 2) for rule in self.took}
        with suppress(OSError):
            COSTS.write_text(json.dumps(costs, indent=1))

    def failed(self, record: logging.LogRecord, event: str | None) -> None:
        """What went wrong, in the words of the job or of Snakemake."""
        if event == LogEvent.JOB_ERROR:
            name = getattr(record, "rule_name", None) or self.rule.get(getattr(record, "jobid", -1), "a job")
            log = ", ".join(map(str, getattr(record, "log", None) or ()))
            self.say(f"{name} failed{f'; its log: {log}' if log else ''}", whole=True)
        elif getattr(record, "exception", None) not in (
            "RuleException",
            "CalledProcessError",
        ):  # told by the job itself
            self.say(record.getMessage().strip(), whole=True)

    def say(self, text: str, whole: bool = False) -> None:
        """Writes a line; on a terminal it is rewritten by the next one unless it is `whole`."""
        self.last = time.monotonic()
        if self.terminal:
            print(f"\r\x1b[K{text}", end="\n" if whole else "", file=sys.stderr, flush=True)
        else:
            print(text, file=sys.stderr, flush=True)
