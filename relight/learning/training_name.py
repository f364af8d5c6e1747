"""The name of a training: its row of the tables and its seed."""

import re
from dataclasses import dataclass

# Of the rows of a run, by their order, in charts of the report and in MLflow.
COLORS = ("#7a5195", "#ef5675", "#ffa600", "#00798c", "#30638e", "#6a994e", "#8d99ae", "#bc6c25")


@dataclass(frozen=True)
class TrainingName:
    """A row and a seed; its `str()` is the name of files, jobs and MLflow runs: `ours_full.s0`.

    >>> TrainingName.parse("ours_full.s0")
    TrainingName(row='ours_full', seed=0)
    >>> str(TrainingName("ours_full", 0))
    'ours_full.s0'
    """

    row: str
    seed: int | None = None

    def __str__(self) -> str:
        return self.row if self.seed is None else f"{self.row}.s{self.seed}"

    @classmethod
    def parse(cls, text: str) -> "TrainingName":
        """Parses a name; without a seed, as for baselines, all of it is the row."""
        match = re.fullmatch(r"(.*)\.s(\d+)", text, re.S)
        return cls(match[1], int(match[2])) if match else cls(text)
