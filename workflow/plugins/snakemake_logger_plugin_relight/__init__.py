"""Snakemake's progress in one line: how far each rule is, and the time left; errors in full, and nothing else."""

import logging
import os
import sys
import time
from collections import Counter, defaultdict

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from relight.progress import span

EVERY = 10.0  # seconds between two lines where there is no terminal


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
            self.say(f"done in {span(time.monotonic() - self.start)}", whole=True)
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
        """The time that the rest takes; only a bound while some rule has not been seen."""
        known = [rule for rule in self.total if self.took[rule]]
        work = sum((self.total[r] - self.done[r]) * sum(self.took[r]) / len(self.took[r]) for r in known)
        unseen = [rule for rule in self.total if not self.took[rule]]
        text = span(work / self.cores)
        return f"{text} left, and then {', '.join(unseen)}" if unseen else f"about {text} left"

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
