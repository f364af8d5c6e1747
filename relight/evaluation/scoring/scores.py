"""Stores the scores of predictors: a row per predictor, test figure and test light."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from relight.core.errors import UserError
from relight.core.files import existing_file, write_text
from relight.evaluation.scoring.truth import in_order
from relight.learning.training_name import TrainingName

KEYS = ["predictor", "figure", "light"]
NAMES = dict.fromkeys(("predictor", "figure", "set", "picture"), str)  # columns that are text, whatever they hold


@dataclass
class Scores:
    """The scores of one predictor.

    Attributes:
        figures: F names.
        lights: L indices.
        columns: name -> (F,L) float64, NaN where there is no score.
    """

    figures: list[str]
    lights: list[int]
    columns: dict[str, np.ndarray]

    def by_subject(self, subjects: dict[str, str]) -> "Scores":
        """Returns the means over the figures of each person, which are not independent of each other.

        Args:
            subjects: figure -> person; a figure that it does not name is a person of its own.
        """
        own = np.array([subjects.get(figure, figure) for figure in self.figures])
        people = list(dict.fromkeys(own.tolist()))
        means = {name: [values[own == person].mean(0) for person in people] for name, values in self.columns.items()}
        return Scores(people, self.lights, {name: np.stack(values) for name, values in means.items()})


def write_scores(path: Path, scores: dict[str, Scores]) -> None:
    """Writes the scores of predictors as CSV, atomically: six significant digits, and blanks for NaN."""
    frames = []
    for predictor, grid in scores.items():
        pairs = pd.MultiIndex.from_product([[predictor], grid.figures, grid.lights], names=KEYS)
        columns = {name: grid.columns[name].ravel() for name in in_order(grid.columns)}
        frames.append(pd.DataFrame(columns, pairs).reset_index())
    table = pd.concat(frames) if frames else pd.DataFrame(columns=KEYS)
    write_text(path, table.to_csv(index=False, float_format="%.6g", lineterminator="\n"))


def read_scores(path: Path) -> dict[str, Scores]:
    """Reads a file of `write_scores`. Raises UserError if it is not one, or a figure lacks a light."""
    table = read_table(path, "scores", KEYS, "the rule evaluate")
    try:
        return {name: _grid(rows) for name, rows in table.groupby("predictor", sort=False)}
    except ValueError as error:
        raise UserError(f"{path} is not a table of scores, as the rule evaluate writes it ({error})") from None


def read_table(path: Path, what: str, columns: list[str], writer: str) -> pd.DataFrame:
    """Reads a CSV table of the workflow; only blanks are NaN. `what` it holds and its `writer` are for errors.

    Raises:
        UserError: if the file is missing, is not CSV, or lacks a column.
    """
    try:
        table = pd.read_csv(existing_file(path, what), dtype=NAMES, keep_default_na=False, na_values=[""])
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{path} is not a table of {what}, as {writer} writes it ({reason})") from None
    if missing := [column for column in columns if column not in table]:
        raise UserError(f"{path} is not a table of {what}, as {writer} writes it (no column {', '.join(missing[:3])})")
    return table


def gather(paths: list[Path]) -> dict[str, list[Scores]]:
    """Reads the scores of each row, one per training, from files with predictors `row` or `row.s<seed>`.

    Raises:
        UserError: if the figures and lights of the files differ.
    """
    rows: dict[str, list[Scores]] = {}
    first: tuple[Path, Scores] | None = None
    for path in paths:
        for name, scores in read_scores(path).items():
            first = first or (path, scores)
            if (scores.figures, scores.lights) != (first[1].figures, first[1].lights):
                raise UserError(f"{path} and {first[0]} are scores of different test pairs: evaluate both on one split")
            rows.setdefault(TrainingName.parse(name).row, []).append(scores)
    return rows


def _grid(rows: pd.DataFrame) -> Scores:
    """Returns the scores of one predictor from their rows; raises ValueError unless they are a full grid of pairs."""
    figures, lights = list(rows["figure"].unique()), [int(light) for light in rows["light"].unique()]
    if list(zip(rows["figure"], rows["light"])) != [(f, l) for f in figures for l in lights]:
        raise ValueError("its rows are not every figure under every light")
    values = rows.drop(columns=KEYS).dropna(axis=1, how="all").astype(np.float64)
    return Scores(figures, lights, {name: values[name].to_numpy().reshape(len(figures), -1) for name in values})
