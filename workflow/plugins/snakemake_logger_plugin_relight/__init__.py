"""Logs Snakemake's progress in one line, with the jobs of each rule and the time left, and errors in full."""

import logging
import os
import sys
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_interface_logger_plugins.settings import LogHandlerSettingsBase

from relight.progress import duration
from snakemake_logger_plugin_relight.costs import Costs, makespan, measured

LOG_INTERVAL = 10.0  # seconds between lines in a log
MAX_NAMED = 3  # stages without a measured job; more are counted
OVERDUE_SHARE = 0.1  # remaining time of a job that takes longer than expected, relative to its time so far
# The shell's status after SIGKILL, which only Snakemake's message shows.
KILLED_MESSAGE = "returned non-zero exit status 137"
TRIVIAL_RULES = ("total", "all", "settings")  # rules that are not counted


@dataclass
class LogHandlerSettings(LogHandlerSettingsBase):
    """The option of the command line, --logger-relight-results."""

    results: str = field(default="", metadata={"help": "Folder of the results, with the costs of earlier jobs."})


class LogHandler(LogHandlerBase):
    """Writes lines such as `12%: figure 12/64, bake 8/64; about 4 min left`; on a terminal, one line is updated."""

    writes_to_stream = True
    writes_to_file = False
    has_filter = True  # otherwise the profile's `quiet` hides the names of the rules, which are counted here
    has_formatter = True
    needs_rulegraph = True

    def __post_init__(self) -> None:
        settings = self.settings or LogHandlerSettings()
        self.costs = Costs(settings.results)
        self.total: dict[str, int] = {}
        self.needs: dict[str, set[str]] = defaultdict(set)
        self.done: Counter[str] = Counter()
        self.rule: dict[int, str] = {}
        self.benchmark: dict[int, str] = {}
        self.since: dict[int, float] = {}  # running jobs and their start
        self.killed: set[int | None] = set()  # threads of Snakemake whose command was killed
        self.cores = os.cpu_count() or 1
        self.start = self.last = time.monotonic()
        self.terminal = sys.stderr.isatty()

    def emit(self, record: logging.LogRecord) -> None:
        event = getattr(record, "event", None)
        if event == LogEvent.RULEGRAPH:
            for link in record.rulegraph["links"]:
                self.needs[link["targetrule"]].add(link["sourcerule"])
        elif event == LogEvent.RESOURCES_INFO:
            self.cores = getattr(record, "cores", None) or getattr(record, "nodes", None) or self.cores
        elif event == LogEvent.RUN_INFO and not self.total:  # a dry run tells it twice
            self.total = {rule: n for rule, n in record.stats.items() if rule not in TRIVIAL_RULES}
            jobs = f"{sum(self.total.values())} jobs"
            if self.total and self.common_settings.dryrun:
                counts = ", ".join(f"{rule} {n}" for rule, n in self.total.items())
                self.say(f"{jobs} would run: {counts}; {self.left()}", lasting=True)
            elif self.total:
                self.say(f"{jobs}; {self.left()}", lasting=True)
        elif event == LogEvent.JOB_INFO:
            self.rule[record.jobid] = record.rule_name
            self.benchmark[record.jobid] = getattr(record, "benchmark", None) or ""
        elif event == LogEvent.JOB_STARTED:
            for job in [record.jobs] if isinstance(record.jobs, int) else record.jobs or ():
                self.since[job] = time.monotonic()
        elif event == LogEvent.JOB_FINISHED:
            self.finished(record.job_id)
        elif event == LogEvent.PROGRESS and record.done == record.total:
            self.say(f"done in {duration(time.monotonic() - self.start)}", lasting=True)
        elif event in (LogEvent.ERROR, LogEvent.JOB_ERROR, LogEvent.GROUP_ERROR) or record.levelno >= logging.ERROR:
            self.failed(record, event)
        elif record.getMessage().startswith("Nothing to be done"):
            self.say(record.getMessage(), lasting=True)

    def finished(self, job: int) -> None:
        """Counts a finished job, and reports the progress if it is time to."""
        rule, now = self.rule.get(job, ""), time.monotonic()
        since = self.since.pop(job, now)
        if rule not in self.total:
            return
        self.done[rule] += 1
        # Snakemake's measurement does not include the time in the queue of a cluster.
        seconds = measured(self.benchmark.get(job, ""))
        self.costs.add(rule, now - since if seconds is None else seconds)
        if self.terminal or now - self.last > LOG_INTERVAL:
            under_way = [rule for rule in self.total if 0 < self.done[rule] < self.total[rule]]
            counts = ", ".join(f"{rule} {self.done[rule]}/{self.total[rule]}" for rule in under_way or [rule])
            share = sum(self.done.values()) / max(1, sum(self.total.values()))
            self.say(f"{share:.0%}: {counts}; {self.left()}")

    def left(self) -> str:
        """Returns the time left: `about` by jobs of this run, `roughly` by earlier ones, else `more than`."""
        now = time.monotonic()
        running = {job: self.rule.get(job, "") for job in self.since if self.rule.get(job) in self.total}
        at_work = Counter(running.values())
        waiting = {rule: max(0, n - self.done[rule] - at_work[rule]) for rule, n in self.total.items()}
        ahead = [rule for rule, n in self.total.items() if self.done[rule] < n]
        cost = {rule: self.costs[rule] for rule in ahead}
        spent = {job: now - self.since[job] for job in running}
        rest = [
            (rule, max((cost[rule] or 0.0) - spent[job], OVERDUE_SHARE * spent[job])) for job, rule in running.items()
        ]
        known = {rule: seconds or 0.0 for rule, seconds in cost.items()}
        cores = min(self.cores, max(1, sum(waiting.values()) + len(rest)))
        seconds = makespan(waiting, known, self.needs, rest, cores)
        if unknown := [rule for rule in ahead if cost[rule] is None]:
            known_part = f"more than {duration(seconds)} left" if seconds else "time left unknown"
            names = ", ".join(unknown) if len(unknown) <= MAX_NAMED else f"{len(unknown)} of the stages"
            return f"{known_part} ({names} not measured yet)"
        return f"{'about' if all(map(self.costs.measured, ahead)) else 'roughly'} {duration(seconds)} left"

    def failed(self, record: logging.LogRecord, event: str | None) -> None:
        """Reports an error of a job or of Snakemake."""
        if event == LogEvent.JOB_ERROR:
            self.since.pop(getattr(record, "jobid", -1), None)
            name = getattr(record, "rule_name", None) or self.rule.get(getattr(record, "jobid", -1), "a job")
            log = ", ".join(map(str, getattr(record, "log", None) or ()))
            how = "failed"
            if record.thread in self.killed:
                how = "was killed, as the system does when memory runs out: run fewer jobs at once (--cores)"
            self.say(f"{name} {how}{f'; its log: {log}' if log else ''}", lasting=True)
        elif getattr(record, "exception", None) in (
            "RuleException",
            "CalledProcessError",
        ):  # reported by the job itself
            # Snakemake logs the exception before the JOB_ERROR, in the same thread.
            if KILLED_MESSAGE in record.getMessage():
                self.killed.add(record.thread)
            else:
                self.killed.discard(record.thread)
        else:
            self.say(record.getMessage().strip(), lasting=True)

    def say(self, text: str, lasting: bool = False) -> None:
        """Writes a line; on a terminal, the next line replaces it unless it is `lasting`."""
        self.last = time.monotonic()
        if self.terminal:
            print(f"\r\x1b[K{text}", end="\n" if lasting else "", file=sys.stderr, flush=True)
        else:
            print(text, file=sys.stderr, flush=True)
