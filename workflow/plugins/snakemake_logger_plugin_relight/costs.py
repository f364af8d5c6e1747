"""What the jobs of a workflow cost, and how long those ahead take on some cores."""

import csv
import heapq
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

# Seconds of a job, measured on two free cores of the machine that the README speaks of. Figures of `laptop`, which
# are drawn in full and tested under fifty lights, follow from CPU seconds each. Other scales were never run whole.
SHARED = {
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
        **SHARED,
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
        **SHARED,
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
LATEST = 8  # jobs that tell how slow this run is


def measured(file: Path | str) -> float | None:
    """The seconds of a job as Snakemake measured them, from its benchmark file; None where there is none."""
    with suppress(OSError, ValueError, KeyError, StopIteration), open(file, newline="") as table:
        return float(next(csv.DictReader(table, delimiter="\t"))["s"])
    return None


class Costs:
    """The seconds of a job of each rule: in this run, or else before it times how much slower this run is.

    Attributes:
        before: seconds by rule from earlier runs in the same folder, and from REFERENCE where there were none.
    """

    def __init__(self, folder: Path | str | None = None, scale: str = ""):
        """
        Args:
            folder: of the results, whose benchmark/<rule>/ holds files of earlier runs.
            scale: a key of REFERENCE; of others, nothing is known before it ran.
        """
        self.before = dict(REFERENCE.get(scale, {}))
        for rule in Path(folder, "benchmark").glob("*") if folder else ():
            seconds = [found for file in rule.rglob("*.tsv") if (found := measured(file)) is not None]
            if seconds:
                self.before[rule.name] = sum(seconds) / len(seconds)
        self._took: dict[str, list[float]] = defaultdict(list)
        self._latest: deque[tuple[float, float]] = deque(maxlen=LATEST)  # seconds, and what was expected

    def add(self, rule: str, seconds: float) -> None:
        """Takes note of a job that has ended."""
        self._took[rule].append(seconds)
        if rule in self.before:
            self._latest.append((seconds, self.before[rule]))

    @property
    def slower(self) -> float:
        """How much longer than before the latest jobs took: other work on the machine, or other settings."""
        took, expected = map(sum, zip(*self._latest)) if self._latest else (1.0, 1.0)
        return took / expected if expected else 1.0

    def measured(self, rule: str) -> bool:
        """Whether a job of the rule has ended in this run."""
        return bool(self._took.get(rule))

    def __getitem__(self, rule: str) -> float | None:
        """The seconds of a job of a rule; None where nothing is known."""
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
    """The seconds until the last job ends, when each starts as soon as a core is free and what it needs is done.

    A job needs all jobs of the rules that its rule needs, which is a little more than Snakemake waits for.

    Args:
        waiting: how many jobs of each rule have not started.
        cost: the seconds of a job of each of these rules.
        needs: by rule, the rules whose outputs it reads.
        running: the rule and the remaining seconds of each job at work.
        cores: jobs side by side.
    """
    ends: dict[str, float] = {}
    free = [0.0] * cores
    for rule, seconds in running:
        ends[rule] = max(ends.get(rule, 0.0), seconds)
        heapq.heapreplace(free, seconds)
    left = {rule: n for rule, n in waiting.items() if n}
    while left:
        ready = {
            rule: max((ends.get(other, 0.0) for other in needs.get(rule, ())), default=0.0)
            for rule in left
            if not any(other in left for other in needs.get(rule, ()) if other != rule)
        }
        rule = min(ready, key=ready.get) if ready else next(iter(left))
        for _ in range(left.pop(rule)):
            end = max(free[0], ready.get(rule, 0.0)) + cost[rule]
            heapq.heapreplace(free, end)
            ends[rule] = max(ends.get(rule, 0.0), end)
    return max(ends.values(), default=0.0)
