"""Estimates the costs of a workflow's jobs, and the time of the remaining ones on some cores."""

import csv
import heapq
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

# Seconds of a job, measured on two free cores of the machine in the README. Those of figures of `laptop` follow from
# CPU-seconds. Other scales were not measured.
COMMON_COSTS = {
    "lights": 34.0,
    "pack": 1.0,
    "split": 1.0,
    "train": 115.0,
    "baselines": 9.0,
    "tables": 3.0,
    "plates": 16.0,
    "sheets": 11.0,
    "viewer": 9.0,
    "report": 10.0,
}
REFERENCE = {
    "smoke": {
        "figure": 6.2,
        "clean": 1.8,
        "align": 0.6,
        "bake": 1.7,
        "pack": 1.0,
        "split": 1.5,
        "lights": 3.6,
        "train": 12.1,
        "evaluate": 10.5,
        "baselines": 3.1,
        "tables": 4.0,
        "plates": 9.1,
        "sheets": 4.9,
        "viewer": 10.4,
        "report": 10.0,
    },
    "demo": {
        **COMMON_COSTS,
        "figure": 7.2,
        "figure_decade": 42.0,
        "clean": 1.7,
        "clean_decade": 6.8,
        "align": 0.6,
        "align_decade": 0.9,
        "bake": 2.0,
        "bake_decade": 5.5,
        "evaluate": 9.6,
        "trace": 60.0,
        "light_transfer": 20.0,
        "path_traced": 20.0,
        "inference_time": 30.0,
    },
    "laptop": {
        **COMMON_COSTS,
        "figure": 15.0,
        "figure_decade": 122.0,
        "clean": 3.0,
        "clean_decade": 15.0,
        "align": 1.0,
        "align_decade": 2.0,
        "bake": 3.0,
        "bake_decade": 10.0,
        "evaluate": 50.0,
        "baselines": 30.0,
    },
}
RECENT_JOBS = 8  # number of jobs from which the slowdown of this run is estimated


def measured(file: Path | str) -> float | None:
    """Returns the seconds of a job from its benchmark file, or None if there is none."""
    with suppress(OSError, ValueError, KeyError, StopIteration), open(file, newline="") as table:
        return float(next(csv.DictReader(table, delimiter="\t"))["s"])
    return None


class Costs:
    """The seconds per job of each rule: those of this run, or earlier ones times the slowdown of this run.

    Attributes:
        before: seconds by rule of earlier runs in the same folder, or of REFERENCE.
    """

    def __init__(self, folder: Path | str | None = None, scale: str = ""):
        """
        Args:
            folder: of the results, with files of earlier runs in benchmark/<rule>/.
            scale: a key of REFERENCE; for other scales, only earlier runs are known.
        """
        self.before = dict(REFERENCE.get(scale, {}))
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
