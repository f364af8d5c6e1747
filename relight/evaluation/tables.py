"""Tables 1 and 2 of the paper from scores of runs: means, intervals, each column's best and what differs from it."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from relight import config
from relight.evaluation.metrics import COLUMNS
from relight.evaluation.paper import QUANTITIES, printed
from relight.evaluation.scores import Scores, read_scores
from relight.evaluation.statistics import (
    Difference,
    Estimate,
    Spread,
    compare,
    estimate,
    holm,
    pooled_spread,
    resample_weights,
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
    **{f"cut_{order}": f"true light, true maps to order {order}" for order in range(2, 8)},
    **{f"order_{order}": f"Ours, order {order}" for order in range(1, 8)},
    **{f"figures_{count}": f"Ours, {count} figures" for count in (8, 16, 32, 64, 128)},
    **{f"width_1_{part}": f"Ours, width 1/{part}" for part in (2, 4, 8)},
}
COLUMNS1 = tuple(f"{quantity}_{reading}" for reading in ("rmse", "ssim") for quantity in QUANTITIES)
COLUMNS2 = tuple(column for column in COLUMNS1 if not column.startswith(("normal", "ao")))
COLUMNS3 = tuple(
    f"{quantity}_{reading}"
    for reading in ("rmse", "ssim")
    for quantity in ("shading", "shading_true_light", "transport", "light", "albedo")
)
PAPER = ("table1", "table2")
TABLES = {  # title and shown columns of the table of an experiment
    "table1": ("Table 1: inference errors of the networks on figures and lights that they have not seen", COLUMNS1),
    "table2": ("Table 2: what leaving out a group of losses does to Ours (full)", COLUMNS2),
    "silhouette": (
        "Shape from mask: transport inferred from the silhouette alone",
        tuple(column for column in COLUMNS3 if column.startswith(("shading_true_light", "transport"))),
    ),
    "self_supervised": ("Self-supervised fine-tuning: pictures without truth", COLUMNS3),
    "sitting": ("Sitting: figures in poses that were not trained on", COLUMNS2),
    "unusual_lights": ("Unusual lights: the test figures under lights that were cut from the set", COLUMNS2),
    "splits": ("Splits: what it is worth to have seen the person before", COLUMNS3),
    "order": ("Order of the spherical harmonics, measured against all bands", COLUMNS3),
    "data_size": ("Number of training figures", COLUMNS3),
    "width": ("Width of the network", COLUMNS3),
}


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
    name: str
    label: str
    baseline: bool
    trainings: int
    cells: dict[str, Cell]


@dataclass
class Table:
    """rows: networks, then baselines; columns: those that are shown, of all that the cells hold; figures and lights:
    how many the test has; printed: row label -> column -> the paper's own value."""

    title: str
    columns: tuple[str, ...]
    rows: list[Row]
    figures: int
    lights: int
    printed: dict[str, dict[str, float]] = field(default_factory=dict)


def gather(paths: list[Path]) -> dict[str, list[Scores]]:
    """Scores by row, one per training, from CSV files whose predictors are called `row` or `row.s<seed>`.

    Raises UserError when they were not taken on the same figures and lights.
    """
    rows: dict[str, list[Scores]] = {}
    first: tuple[Path, Scores] | None = None
    for path in paths:
        for name, scores in read_scores(path).items():
            first = first or (path, scores)
            if (scores.figures, scores.lights) != (first[1].figures, first[1].lights):
                raise UserError(f"{path} and {first[0]} are scores of different test pairs: evaluate both on one split")
            rows.setdefault(re.sub(r"\.s\d+$", "", name), []).append(scores)
    return rows


def experiment_table(
    name: str,
    rows: dict[str, list[Scores]],
    baselines: dict[str, list[Scores]],
    settings: config.Evaluate,
    pool: dict[str, list[Scores]] | None = None,
) -> Table:
    """The table of the experiment `name`, a preset's, over its rows; pool: as for `build`. The paper's own values stand
    in those that it prints: they are of other figures, lights and trainings than those of the others."""
    table = build(*titled(name), rows, baselines, settings, pool)
    return table if name in PAPER else replace(table, printed={})


def titled(name: str) -> tuple[str, tuple[str, ...]]:
    """Title and shown columns of the table of an experiment."""
    return TABLES.get(name, (f"{name}: inference errors", COLUMNS1))


def build(
    title: str,
    columns: tuple[str, ...],
    networks: dict[str, list[Scores]],
    baselines: dict[str, list[Scores]],
    settings: config.Evaluate,
    pool: dict[str, list[Scores]] | None = None,
) -> Table:
    """A table of any runs: every column of the scores is estimated, `columns` are those to show.

    pool: the runs that tell how much trainings spread, those of the table if None.
    """
    if not networks:
        raise UserError(f"{title}: there is no run to put in it")
    some = next(iter(networks.values()))[0]
    weights = resample_weights(len(some.figures), settings.bootstrap, settings.seed)
    spreads = spread_of_trainings(networks if pool is None else pool)
    rows = []
    for place, (name, trainings) in enumerate([*networks.items(), *baselines.items()]):
        seed, known = settings.seed + place, spreads if place < len(networks) else {}
        cells = {
            column: Cell(estimate(values(trainings, column), weights, seed, known.get(column)))
            for column in COLUMNS
            if all(column in scores.columns for scores in trainings)
        }
        rows.append(Row(name, LABELS.get(name, name), place >= len(networks), len(trainings), cells))
    rank(rows, columns)
    known = {f"{row.label}, as printed": printed(row.name) for row in rows}
    return Table(
        title, columns, rows, len(some.figures), len(some.lights), {label: v for label, v in known.items() if v}
    )


def values(trainings: list[Scores], column: str) -> np.ndarray:
    """(S,F): the mean over lights of each training and figure."""
    return np.stack([scores.figure_means(column) for scores in trainings])


def spread_of_trainings(rows: dict[str, list[Scores]], columns: tuple[str, ...] = COLUMNS) -> dict[str, Spread]:
    """How much the means of each column spread from training to training, pooled over all rows that have it."""
    return {
        column: pooled_spread([values(t, column) for t in rows.values() if all(column in s.columns for s in t)])
        for column in columns
    }


def rank(rows: list[Row], columns: tuple[str, ...]) -> None:
    """Marks the best network of each column and compares the others with it. The p-values of `columns` are corrected
    together, and so are those of all other columns."""
    for group in (columns, tuple(column for column in COLUMNS if column not in columns)):
        compared = []
        for column in group:
            cells = [row.cells[column] for row in rows if not row.baseline and column in row.cells]
            if len(cells) < 2:
                continue
            best = min(cells, key=lambda cell: sign(column) * cell.estimate.mean)
            best.best = True
            for cell in cells:
                if cell is not best:
                    cell.against = compare(cell.estimate, best.estimate)
                    compared.append(cell)
        for cell, p in zip(compared, holm([cell.against.p for cell in compared])):
            cell.p = float(p)


def sign(column: str) -> int:
    """1 where less is better (errors), -1 where more is (similarities)."""
    return -1 if "_ssim" in column else 1
