"""Tables of experiments from the scores of their runs: means, intervals, each column's best."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from relight import config
from relight.evaluation.metrics import COLUMNS
from relight.evaluation.paper import QUANTITIES, printed
from relight.evaluation.scores import Scores
from relight.evaluation.statistics import (
    Difference,
    Estimate,
    Spread,
    compare,
    estimate,
    holm,
    pooled_spread,
)
from relight.files import UserError

ALPHA = 0.05
LABELS = {
    "sfsnet": "SfSNet",
    "sfsnet_ao": "SfSNet-AO",
    "ours_min": "Ours (min)",
    "ours_full": "Ours (full)",
    "ours_plus": "Ours plus",
    "no_tv": "w/o TV",
    "no_shading": "w/o shading",
    "no_reconstruction": "w/o reconstruction",
    "sfsnet_ao_full": "SfSNet-AO, all losses",
    "plus_no_weight": "plus w/o weight of the transport",
    "plus_no_refinement": "plus w/o refined light",
    "plus_no_mirror": "plus w/o mirroring",
    "plus_no_average": "plus w/o averaged weights",
    "silhouette": "Mask alone",
    "transport_only": "Picture, same losses",
    "self_encoder": "Encoder fine-tuned",
    "self_all": "Everything fine-tuned",
    "ours_rich": "Ours, richer lights",
    "ours_disjoint": "Ours, person not seen",
    "ours_siblings": "Ours, person seen",
    "mean_figure": "mean training figure, mean light",
    "mean_light": "true maps, mean training light",
    "nearest_light": "true maps, nearest training light",
    "no_occlusion": "true light, true normals without occlusion",
    "ao_occlusion": "true light, true normals and AO",
    "as_it_is": "the picture as it is",
    **{f"cut_{order}": f"true light, true maps to order {order}" for order in range(2, 8)},
    **{f"order_{order}": f"Ours, order {order}" for order in range(1, 8)},
    **{f"figures_{count}": f"Ours, {count} figures" for count in (8, 16, 32, 64, 128)},
    **{f"width_1_{part}": f"Ours, width 1/{part}" for part in (2, 4, 8)},
}
QUANTITY = {
    "shading": "Shading",
    "shading_true_light": "Shading, true light",
    "transport": "Transport",
    "transport_with_ao": "Transport × AO",
    "normal": "Normal",
    "ao": "AO",
    "light": "Light",
    "sphere": "Sphere",
    "albedo": "Albedo",
    "reconstruction": "Reconstruction",
    "relit": "Relit",
}
READING = {"rmse": "RMSE", "rmse_element": "RMSE per element", "ssim": "SSIM", "ssim_range2": "SSIM, range 2"}


def _columns(*quantities: str) -> tuple[str, ...]:
    return tuple(f"{quantity}_{reading}" for reading in ("rmse", "ssim") for quantity in quantities)


ALL = _columns(*QUANTITIES)  # of Table 1
MAPS = _columns("shading", "transport", "light", "albedo")  # of Table 2
PARTS = _columns("shading", "shading_true_light", "transport", "light", "albedo")
SHOWN = {  # the columns that the table of an experiment shows; ALL where nothing else is said
    "table2": MAPS,
    "sitting": MAPS,
    "unusual_lights": MAPS,
    "silhouette": _columns("shading_true_light", "transport"),
    "relit": _columns("relit", "reconstruction", "shading_true_light", "albedo"),
    **dict.fromkeys(("self_supervised", "splits", "order", "data_size", "width", "equal_losses", "plus_parts"), PARTS),
}
PRINTED = ("table1", "table2")  # the tables that the paper prints


@dataclass
class Cell:
    """One value of a table. `against` is its paired difference from the best network of the column, None for the best
    itself and for baselines; `p` is that difference's p-value, corrected for all that the table compares (Holm)."""

    estimate: Estimate
    best: bool = False
    against: Difference | None = None
    p: float | None = None

    @property
    def undecided(self) -> bool:
        """Whether it cannot be told from the best value of its column."""
        return self.p is not None and self.p >= ALPHA


@dataclass
class Row:
    """A network, or a baseline, with its cells by column."""

    name: str
    baseline: bool
    trainings: int
    cells: dict[str, Cell]

    @property
    def label(self) -> str:
        return LABELS.get(self.name, self.name)


@dataclass
class Table:
    """rows: networks, then baselines; columns: those that are shown, of all that the cells hold; figures, lights: how
    many the test has; printed: row name -> column -> the paper's own value."""

    columns: tuple[str, ...]
    rows: list[Row] = field(default_factory=list)
    figures: int = 0
    lights: int = 0
    printed: dict[str, dict[str, float]] = field(default_factory=dict)

    def row(self, name: str) -> Row | None:
        """The row of a network or a baseline, if the table has it."""
        return next((one for one in self.rows if one.name == name), None)

    @property
    def networks(self) -> list[Row]:
        return [row for row in self.rows if not row.baseline]

    @property
    def trainings(self) -> list[int]:
        """How many trainings the networks' rows have: the least and the most."""
        counts = [row.trainings for row in self.networks] or [0]
        return [min(counts), max(counts)]

    def blocks(self, columns: tuple[str, ...]) -> dict[str, list[str]]:
        """Those of `columns` that some row has, by reading."""
        found: dict[str, list[str]] = {}
        for column in columns:
            if any(column in row.cells for row in self.rows):
                found.setdefault(split_column(column)[1], []).append(column)
        return found

    def statistics(self) -> pd.DataFrame:
        """All columns, shown or not: mean, 95 % interval, and the p-value of the difference from the best network."""
        columns = [column for part in self.blocks(COLUMNS).values() for column in part]
        lines = []
        for row in self.rows:
            line = {"row": row.name, "kind": "baseline" if row.baseline else "network", "trainings": row.trainings}
            for column, cell in row.cells.items():
                one = cell.estimate
                line |= {f"{column}{end}": round(getattr(one, end.strip("_") or "mean"), 5) for end in ENDS[:-1]}
                line[f"{column}_p"] = np.nan if cell.p is None else float(f"{cell.p:.4g}")
            lines.append(line)
        lines += [{"row": name, "kind": "paper", "trainings": 1, **values} for name, values in self.printed.items()]
        return pd.DataFrame(lines, columns=["row", "kind", "trainings", *(c + end for c in columns for end in ENDS)])


ENDS = ("", "_low", "_high", "_p")  # of the columns of `Table.statistics`


def experiment_table(
    name: str,
    networks: dict[str, list[Scores]],
    baselines: dict[str, list[Scores]],
    settings: config.Evaluate,
    pool: dict[str, list[Scores]] | None = None,
) -> Table:
    """The table of an experiment: every column of the scores is estimated, SHOWN are those to show.

    Args:
        name: of the experiment, as in conf/experiment. The paper's own values stand in the tables that it prints.
        networks: row -> its trainings, in the order of the table.
        baselines: the same; they follow, and do not compete.
        settings: how many resamples, and their seed.
        pool: the runs that tell how much trainings spread; those of the table if None.

    Raises:
        UserError: there is no run.
    """
    if not networks:
        raise UserError(f"{name}: there is no run to put in its table")
    some = next(iter(networks.values()))[0]
    spreads = spread_of_trainings(networks if pool is None else pool)
    columns, rows = SHOWN.get(name, ALL), []
    for place, (row, trainings) in enumerate([*networks.items(), *baselines.items()]):
        known = spreads if place < len(networks) else {}
        cells = {
            column: Cell(estimated(trainings, column, settings, known.get(column), place))
            for column in COLUMNS
            if all(column in scores.columns for scores in trainings)
        }
        rows.append(Row(row, place >= len(networks), len(trainings), cells))
    rank(rows, columns)
    known = {row.name: printed(row.name) for row in rows if name in PRINTED}
    return Table(columns, rows, len(some.figures), len(some.lights), {row: v for row, v in known.items() if v})


def values(trainings: list[Scores], column: str) -> np.ndarray:
    """(S,F,L): a column of the scores of a row's trainings."""
    return np.stack([scores.columns[column] for scores in trainings])


def estimated(
    trainings: list[Scores], column: str, settings: config.Evaluate, spread: Spread | None = None, place: int = 0
) -> Estimate:
    """Mean and interval of a column of a row's scores; `place` of the row among those that are read together."""
    given = values(trainings, column), settings.bootstrap, settings.seed
    pairs = trainings[0].figures, trainings[0].lights
    return estimate(*given, spread, pairs, noise=settings.seed + place)


def spread_of_trainings(rows: dict[str, list[Scores]], columns: tuple[str, ...] = COLUMNS) -> dict[str, Spread]:
    """How much the means of each column spread from training to training, pooled over all rows that have it."""
    return {
        column: pooled_spread([values(t, column) for t in rows.values() if all(column in s.columns for s in t)])
        for column in columns
    }


def estimates(
    rows: dict[str, list[Scores]],
    column: str,
    settings: config.Evaluate,
    pool: dict[str, list[Scores]],
    fixed: Iterable[str] = (),
) -> dict[str, Estimate]:
    """Row -> mean and interval of any column of the scores, in a table or not; rows without the column are left out.

    pool: the rows that tell how much trainings spread; fixed: rows that no training is behind.
    """
    if not rows:
        return {}
    spread = spread_of_trainings(pool, (column,))[column]
    return {
        row: estimated(trainings, column, settings, None if row in fixed else spread, i)
        for i, (row, trainings) in enumerate(rows.items())
        if all(column in scores.columns for scores in trainings)
    }


def rank(rows: list[Row], columns: tuple[str, ...]) -> None:
    """Marks the best network of each column and compares the others with it. The p-values of `columns` are corrected
    together, and so are those of all other columns."""
    for group in (columns, tuple(column for column in COLUMNS if column not in columns)):
        found = []
        for column in group:
            cells = [row.cells[column] for row in rows if not row.baseline and column in row.cells]
            if len(cells) < 2:
                continue
            best = min(cells, key=lambda cell: sign(column) * cell.estimate.mean)
            best.best = True
            for cell in cells:
                if cell is not best:
                    cell.against = compare(cell.estimate, best.estimate)
                    found.append(cell)
        for cell, p in zip(found, holm([cell.against.p for cell in found])):
            cell.p = float(p)


def sign(column: str) -> int:
    """1 where less is better (errors), -1 where more is (similarities)."""
    return -1 if "_ssim" in column else 1


def split_column(column: str) -> tuple[str, str]:
    """shading_true_light_rmse -> (shading_true_light, rmse)."""
    reading = max((r for r in READING if column.endswith(f"_{r}")), key=len)
    return column.removesuffix(f"_{reading}"), reading
