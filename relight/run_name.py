"""The name of a training: its run (a row of the tables) and its seed."""

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class RunName:
    """A run and a seed; its `str()` is the name of files, jobs and runs in MLflow: `ours_full.s0`.

    >>> RunName.parse("ours_full.s0")
    RunName(run='ours_full', seed=0)
    >>> str(RunName("ours_full", 0))
    'ours_full.s0'
    """

    run: str
    seed: int | None = None

    def __str__(self) -> str:
        return self.run if self.seed is None else f"{self.run}.s{self.seed}"

    @classmethod
    def parse(cls, text: str) -> "RunName":
        """Parses a name; without a seed, as for baselines, all of it is the run."""
        found = re.fullmatch(r"(.*)\.s(\d+)", text, re.S)
        return cls(found[1], int(found[2])) if found else cls(text)
