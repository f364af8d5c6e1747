"""Estimates the costs of a workflow's jobs, and the time of the remaining ones on some cores."""

import csv
import heapq
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

RECENT_JOBS = 8  # number of jobs from which the slowdown of this run is estimated


def measured(file: Path | str) -> float | None:
    """Returns the seconds of a job from its benchmark file, or None if there is none."""
    with suppress(OSError, ValueError, KeyError, StopIteration), open(file, newline="") as table:
        return float(next(csv.DictReader(table, delimiter="\t"))["s"])
    return None


class Costs:
    """The seconds per job of each rule: those of this run, or earlier ones times the slowdown of this run.

    Attributes:
        before: seconds by rule of earlier runs in the same folder.
    """

    def __init__(self, folder: Path | str | None = None):
        """Reads the files of earlier runs in benchmark/<rule>/ of the folder of the results, if one is given."""
        self.before: dict[str, float] = {}
        for rule in Path(folder, "benchmark").glob("*") if folder else ():
            seconds = [found for file in rule.rglob("*.tsv") if (found := measured(file)) is not None]
            if seconds:
                self.before[rule.name] = sum(seconds) / len(seconds)
        self._took: dict[str, list[float]] = defaultdict(list)
        self._latest: deque[tuple[float, float]] = deque(maxlen=RECENT_JOBS)  # measured and expected seconds

    def add(self, rule: str, seconds: float) -> None:
        """Records a job that has ended."""
        self._took[rule].append(seconds)
        if rule in self.before:
            self._latest.append((seconds, self.before[rule]))

    @property
    def slower(self) -> float:
        """The ratio of measured to expected seconds of recent jobs, due to other load or other settings."""
        took, expected = map(sum, zip(*self._latest)) if self._latest else (1.0, 1.0)
        return took / expected if expected else 1.0

    def measured(self, rule: str) -> bool:
        """Returns whether a job of the rule has ended in this run."""
        return bool(self._took.get(rule))

    def __getitem__(self, rule: str) -> float | None:
        """Returns the seconds of a job of a rule, or None if unknown."""
        if seconds := self._took.get(rule):
            return sum(seconds) / len(seconds)
        return self.slower * self.before[rule] if rule in self.before else None


def makespan(
    waiting: Mapping[str, int],
    cost: Mapping[str, float],
    needs: Mapping[str, Iterable[str]],
    running: Iterable[tuple[str, float]],
    cores: int,
) -> float:
    """Returns the seconds until the last job ends, if each starts as soon as a core is free and its inputs are there.

    Jobs wait for all jobs of the rules that their rule needs, while Snakemake waits only for their inputs.

    Args:
        waiting: rule -> number of jobs that have not started.
        cost: rule -> seconds per job.
        needs: rule -> rules whose outputs it reads.
        running: rule and remaining seconds of each running job.
        cores: number of jobs at the same time.
    """
    ends: dict[str, float] = {}
    free = [0.0] * cores
    for rule, seconds in running:
        ends[rule] = max(ends.get(rule, 0.0), seconds)
        heapq.heapreplace(free, seconds)
    remaining = {rule: n for rule, n in waiting.items() if n}
    while remaining:
        ready = {
            rule: max((ends.get(other, 0.0) for other in needs.get(rule, ())), default=0.0)
            for rule in remaining
            if not any(other in remaining for other in needs.get(rule, ()) if other != rule)
        }
        rule = min(ready, key=ready.get) if ready else next(iter(remaining))
        for _ in range(remaining.pop(rule)):
            end = max(free[0], ready.get(rule, 0.0)) + cost[rule]
            heapq.heapreplace(free, end)
            ends[rule] = max(ends.get(rule, 0.0), end)
    return max(ends.values(), default=0.0)
