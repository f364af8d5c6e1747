"""Computes the tables of experiments from scores: means, intervals, and the best network of each column."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from relight.evaluation.scoring.paper import printed
from relight.evaluation.scoring.scores import Scores
from relight.evaluation.scoring.statistics import Estimate, compare, estimate, holm, pooled_spread
from relight.evaluation.scoring.truth import in_order
from relight.settings.scores import COLUMNS, PRINTED, READINGS, columns_of, label, sign

PRINTED_TABLES = ("table1", "table2")  # that the paper prints
TABLE1_COLUMNS = columns_of(*PRINTED)  # of Table 1
TABLE2_COLUMNS = columns_of("shading", "transport", "light", "albedo")  # of Table 2

Rows = dict[str, list[Scores]]  # row -> the scores of its trainings


@dataclass
class Table:
    """The estimates of an experiment.

    Attributes:
        columns: those to show.
        rows: network or baseline -> column -> estimate; networks come first, in the order of the experiment.
        trainings: network -> number of trainings.
        subjects, lights: numbers of test subjects (people) and test lights.
        printed: row -> column -> the paper's value.
        labels: row -> its label, where an experiment of the run gives one.
    """

    columns: tuple[str, ...]
    rows: dict[str, dict[str, Estimate]] = field(default_factory=dict)
    trainings: dict[str, int] = field(default_factory=dict)
    subjects: int = 0
    lights: int = 0
    printed: dict[str, dict[str, float]] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)

    @property
    def networks(self) -> list[str]:
        """The rows that are networks."""
        return list(self.trainings)

    @property
    def trainings_range(self) -> tuple[int, int]:
        """The least and the largest number of trainings of a network."""
        counts = self.trainings.values()
        return min(counts, default=0), max(counts, default=0)

    def kind(self, row: str) -> str:
        """Returns "network" or "baseline"."""
        return "network" if row in self.trainings else "baseline"

    def label(self, row: str) -> str:
        """Returns the label of a row."""
        return self.labels.get(row, label(row))

    @property
    def scored(self) -> list[str]:
        """All columns that a row has, also those not shown."""
        return in_order(column for cells in self.rows.values() for column in cells)

    def present(self, columns: Iterable[str]) -> list[str]:
        """Returns those of the given columns that a network has, sorted by reading."""
        return by_reading(column for column in columns if any(column in self.rows[row] for row in self.networks))

    def statistics(self) -> pd.DataFrame:
        """Returns all columns, also those not shown: mean, 95 % interval, and p-value against the best network."""
        lines = []
        for row, cells in self.rows.items():
            line = {"row": row, "kind": self.kind(row), "trainings": self.trainings.get(row, 1)}
            for column, cell in cells.items():
                ends = {"": cell.mean, "_low": cell.low, "_high": cell.high}
                line |= {f"{column}{end}": round(value, 5) for end, value in ends.items()}
                line[f"{column}_p"] = np.nan if cell.p is None else float(f"{cell.p:.4g}")
            lines.append(line)
        lines += [{"row": name, "kind": "paper", "trainings": 1, **values} for name, values in self.printed.items()]
        numbers = [f"{column}{end}" for column in by_reading(self.scored) for end in ("", "_low", "_high", "_p")]
        return pd.DataFrame(lines, columns=["row", "kind", "trainings", *numbers])


def by_reading(columns: Iterable[str]) -> list[str]:
    """Sorts columns of scores by their reading, in the order of READINGS."""
    return sorted(columns, key=lambda column: list(READINGS).index(COLUMNS[column][1]))


def experiment_table(
    name: str, networks: Rows, baselines: Rows, columns: tuple[str, ...] = TABLE1_COLUMNS, pool: Rows | None = None
) -> Table:
    """Estimates every column of the scores of an experiment.

    Args:
        name: name of the experiment, which selects the paper's printed values.
        networks: in the order of the table.
        baselines: follow the networks; they are never marked as best.
        columns: to show.
        pool: rows over which the spread of trainings is pooled; by default `networks`.

    Returns:
        The table, with the best network of each column, and the p-values of the others' differences from it.
    """
    given = {**networks, **baselines}
    rows: dict[str, dict[str, Estimate]] = {row: {} for row in given}
    scored = in_order(column for trainings in given.values() for scores in trainings for column in scores.columns)
    for column in scored:
        for row, cell in estimates(given, column, networks if pool is None else pool, baselines).items():
            rows[row][column] = cell
    for group in (columns, [column for column in scored if column not in columns]):
        rank([rows[row] for row in networks], group)
    any_scores = next(iter(networks.values()))[0]  # all have the same figures and lights
    trainings = {row: len(scores) for row, scores in networks.items()}
    values = {row: printed(row) for row in rows if name in PRINTED_TABLES and printed(row)}
    return Table(columns, rows, trainings, len(any_scores.figures), len(any_scores.lights), values)


def estimates(rows: Rows, column: str, pool: Rows, fixed: Iterable[str] = ()) -> dict[str, Estimate]:
    """Estimates a column of the scores by row, without rows that lack it.

    The spread of trainings is pooled over the rows of `pool`; rows of `fixed` have no trainings.
    """

    def values(trainings: list[Scores]) -> np.ndarray | None:
        given = [scores.columns[column] for scores in trainings if column in scores.columns]
        return np.stack(given) if len(given) == len(trainings) else None

    spread = pooled_spread([given for trainings in pool.values() if (given := values(trainings)) is not None])
    estimated = {}
    for number, (row, trainings) in enumerate(rows.items()):
        if (given := values(trainings)) is not None:
            row_spread = None if row in fixed else spread
            figures_and_lights = trainings[0].figures, trainings[0].lights
            relit = COLUMNS[column][0] == "relit"
            estimated[row] = estimate(given, row_spread, figures_and_lights, noise_seed=number, chained=relit)
    return estimated


def rank(networks: list[dict[str, Estimate]], columns: Iterable[str]) -> None:
    """Marks the best network of each column that has a `sign`, and compares the others with it, in place.

    P-values are corrected over the columns (Holm).
    """
    others, p = [], []
    for column in columns:
        cells = [row[column] for row in networks if column in row]
        if len(cells) < 2 or not sign(column):
            continue
        best = min(cells, key=lambda cell: sign(column) * cell.mean)
        best.best = True
        others += [cell for cell in cells if cell is not best]
        p += [compare(cell, best).p for cell in cells if cell is not best]
    for cell, corrected in zip(others, holm(p)):
        cell.p = float(corrected)
