"""Tables of experiments from the scores of their runs: means, intervals, each column's best."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from relight import config
from relight.evaluation.labels import split_column
from relight.evaluation.metrics import COLUMNS, READINGS
from relight.evaluation.paper import printed
from relight.evaluation.scores import Scores
from relight.evaluation.statistics import Estimate, compare, estimate, holm, pooled_spread
from relight.files import UserError


def _columns(*quantities: str) -> tuple[str, ...]:
    return tuple(f"{quantity}_{reading}" for reading in ("rmse", "ssim") for quantity in quantities)


PRINTED = ("table1", "table2")  # the tables that the paper prints
ALL = _columns("shading", "transport", "normal", "ao", "light", "albedo")  # of Table 1
MAPS = _columns("shading", "transport", "light", "albedo")  # of Table 2
PARTS = _columns("shading", "shading_true_light", "transport", "light", "albedo")
SHOWN = {  # the columns that the table of an experiment shows; ALL where nothing else is said
    "table2": MAPS,
    "sitting": MAPS,
    "unusual_lights": MAPS,
    "silhouette": _columns("shading_true_light", "transport"),
    "relit": _columns("relit", "reconstruction", "shading_true_light", "albedo"),
    **dict.fromkeys(("self_supervised", "splits", "order", "data_size", "width"), PARTS),
    **dict.fromkeys(("equal_losses", "plus_parts", "steps"), PARTS),
}

Rows = dict[str, list[Scores]]  # row -> the scores of its trainings


@dataclass
class Table:
    """What an experiment measured.

    Attributes:
        columns: those that are shown, of all that the rows have.
        rows: name of a network or baseline -> column -> estimate; networks first, in the order of the experiment.
        trainings: how many each network has, by row; baselines have none.
        figures, lights: how many the test has.
        printed: row -> column -> the paper's own value.
    """

    columns: tuple[str, ...]
    rows: dict[str, dict[str, Estimate]] = field(default_factory=dict)
    trainings: dict[str, int] = field(default_factory=dict)
    figures: int = 0
    lights: int = 0
    printed: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def networks(self) -> list[str]:
        """The rows that are networks."""
        return list(self.trainings)

    @property
    def baselines(self) -> list[str]:
        """The rows that are baselines."""
        return [row for row in self.rows if row not in self.trainings]

    @property
    def trainings_range(self) -> tuple[int, int]:
        """How many trainings the networks have: the least and the most."""
        counts = self.trainings.values()
        return min(counts, default=0), max(counts, default=0)

    def kind(self, row: str) -> str:
        """Whether a row is a "network" or a "baseline"."""
        return "network" if row in self.trainings else "baseline"

    def present(self, columns: Iterable[str]) -> list[str]:
        """Those of some columns that a row has, by reading."""
        found = [column for column in columns if any(column in cells for cells in self.rows.values())]
        return sorted(found, key=lambda column: READINGS.index(split_column(column)[1]))

    def statistics(self) -> pd.DataFrame:
        """All columns, shown or not: mean, 95 % interval, and the p-value of the difference from the best network."""
        lines = []
        for row, cells in self.rows.items():
            line = {"row": row, "kind": self.kind(row), "trainings": self.trainings.get(row, 1)}
            for column, cell in cells.items():
                ends = {"": cell.mean, "_low": cell.low, "_high": cell.high}
                line |= {f"{column}{end}": round(value, 5) for end, value in ends.items()}
                line[f"{column}_p"] = np.nan if cell.p is None else float(f"{cell.p:.4g}")
            lines.append(line)
        lines += [{"row": name, "kind": "paper", "trainings": 1, **values} for name, values in self.printed.items()]
        numbers = [f"{column}{end}" for column in self.present(COLUMNS) for end in ("", "_low", "_high", "_p")]
        return pd.DataFrame(lines, columns=["row", "kind", "trainings", *numbers])


def experiment_table(
    name: str, networks: Rows, baselines: Rows, settings: config.Evaluate, pool: Rows | None = None
) -> Table:
    """Estimates every column of the scores of an experiment.

    Args:
        name: of the experiment, as in conf/experiment: it says which columns are shown, and whether the paper prints
            the table.
        networks: in the order of the table.
        baselines: they follow, and do not compete.
        settings: how many resamples, and their seed.
        pool: the rows that tell how much trainings spread; `networks` if None.

    Returns:
        The table, with the best network of each column and the p-values of the others' differences from it.

    Raises:
        UserError: there is no run.
    """
    if not networks:
        raise UserError(f"{name}: there is no run to put in its table")
    given = {**networks, **baselines}
    rows: dict[str, dict[str, Estimate]] = {row: {} for row in given}
    for column in COLUMNS:
        for row, one in estimates(given, column, settings, networks if pool is None else pool, baselines).items():
            rows[row][column] = one
    columns = SHOWN.get(name, ALL)
    rank([rows[row] for row in networks], columns)
    trainings, some = {row: len(scores) for row, scores in networks.items()}, next(iter(networks.values()))[0]
    known = {row: printed(row) for row in rows if name in PRINTED and printed(row)}
    return Table(columns, rows, trainings, len(some.figures), len(some.lights), known)


def estimates(
    rows: Rows, column: str, settings: config.Evaluate, pool: Rows, fixed: Iterable[str] = ()
) -> dict[str, Estimate]:
    """Estimates one column of the scores, in a table or not.

    Args:
        rows: that are read together.
        column: of the scores.
        settings: how many resamples, and their seed.
        pool: the rows that tell how much trainings spread.
        fixed: the rows that no training is behind.

    Returns:
        Row -> mean and interval; rows without the column are left out.
    """

    def values(trainings: list[Scores]) -> np.ndarray | None:
        """(S,F,L), where all trainings have the column."""
        has = all(column in scores.columns for scores in trainings)
        return np.stack([scores.columns[column] for scores in trainings]) if has else None

    spread = pooled_spread([given for trainings in pool.values() if (given := values(trainings)) is not None])
    found = {}
    for place, (row, trainings) in enumerate(rows.items()):
        if (given := values(trainings)) is not None:
            own, pairs = None if row in fixed else spread, (trainings[0].figures, trainings[0].lights)
            noise = settings.seed + place
            found[row] = estimate(given, settings.bootstrap, settings.seed, own, pairs, noise)
    return found


def rank(networks: list[dict[str, Estimate]], columns: tuple[str, ...]) -> None:
    """Marks the best network of each column, and compares the others with it, in place.

    Args:
        networks: the estimates of each, by column.
        columns: their p-values are corrected together (Holm), and so are those of all other columns.
    """
    for group in (columns, tuple(column for column in COLUMNS if column not in columns)):
        others, p = [], []
        for column in group:
            cells = [row[column] for row in networks if column in row]
            if len(cells) < 2:
                continue
            best = min(cells, key=lambda cell: sign(column) * cell.mean)
            best.best = True
            others += [cell for cell in cells if cell is not best]
            p += [compare(cell, best).p for cell in cells if cell is not best]
        for cell, corrected in zip(others, holm(p)):
            cell.p = float(corrected)


def sign(column: str) -> int:
    """1 where less is better (errors), -1 where more is (similarities)."""
    return -1 if "_ssim" in column else 1
