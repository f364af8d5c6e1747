"""The scores of predictors: a table with one row per predictor, test figure and test light, as CSV and in memory."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.evaluation.metrics import COLUMNS, SIGNS
from relight.files import UserError, existing, whole

KEYS = ("predictor", "figure", "light")


@dataclass
class Scores:
    """columns: name -> (F,L) float64, NaN where the predictor has no say; figures: F names; lights: L indices."""

    figures: list[str]
    lights: list[int]
    columns: dict[str, np.ndarray]

    def figure_means(self, column: str) -> np.ndarray:
        """(F,) the mean over lights of each figure: what the bootstrap over figures resamples."""
        return self.columns[column].mean(1)


def write_scores(path: Path, scores: dict[str, Scores]) -> None:
    """Writes the CSV of some predictors, six significant digits, blanks for NaN; whole or not at all."""
    with whole(path) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*KEYS, *COLUMNS, *SIGNS])
        for predictor, one in scores.items():
            blank = np.full((len(one.figures), len(one.lights)), np.nan)
            grid = np.stack([one.columns.get(column, blank) for column in (*COLUMNS, *SIGNS)], -1)
            for figure, rows in zip(one.figures, grid):
                for light, values in zip(one.lights, rows):
                    cells = ("" if np.isnan(value) else f"{value:.6g}" for value in values)
                    writer.writerow([predictor, figure, light, *cells])


def read_scores(path: Path) -> dict[str, Scores]:
    """Reads what `write_scores` wrote: {} where there was nothing to score. UserError on a file that is not full grids
    of figure x light."""
    try:
        with open(existing(path, "scores"), newline="") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
        if not set(KEYS) <= set(reader.fieldnames or ()):
            raise ValueError(f"it lacks the columns {', '.join(KEYS)}")
        names = [name for name in reader.fieldnames if name not in KEYS]
        return {
            predictor: _grid([row for row in rows if row["predictor"] == predictor], names)
            for predictor in dict.fromkeys(row["predictor"] for row in rows)
        }
    except (KeyError, ValueError, TypeError, csv.Error) as error:
        raise UserError(f"{path} is not a table of scores, as relight-evaluate writes it ({error})") from None


def _grid(rows: list[dict[str, str]], names: list[str]) -> Scores:
    figures = list(dict.fromkeys(row["figure"] for row in rows))
    lights = list(dict.fromkeys(int(row["light"]) for row in rows))
    if [(row["figure"], int(row["light"])) for row in rows] != [(f, l) for f in figures for l in lights]:
        raise ValueError("its rows are not every figure under every light")
    values = np.array([[float(row[name] or "nan") for name in names] for row in rows])
    values = values.reshape(len(figures), len(lights), len(names))
    columns = {name: values[..., i] for i, name in enumerate(names)}
    return Scores(figures, lights, {name: v for name, v in columns.items() if not np.isnan(v).all()})
