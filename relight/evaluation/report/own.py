"""Computes the numbers of experiments that are not tables of trainings, and writes their tables.

OWN has the function of each, which returns the context of templates/sections/experiment.md.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from relight.evaluation.experiments import transfer
from relight.evaluation.experiments.path_traced import ANSWERS, CAUSES, COLUMNS, KEYS
from relight.evaluation.report.formats import TextTable, comparison_grid, write_tables
from relight.evaluation.report.page import text
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import compare_estimates, correct
from relight.evaluation.scoring.labels import label
from relight.evaluation.scoring.scores import gather, read_table
from relight.evaluation.scoring.statistics import estimate
from relight.evaluation.scoring.tables import estimates
from relight.learning.training_name import TrainingName

Numbers = dict[str, Any]
# What light transfer compares for each network: two predictors, whose names follow that of the network.
SWAPS = {
    "against the picture as it is": ("", "as_it_is"),
    "against its own maps under the mean light": ("", ":mean_light"),
    "with the true light against with the true maps": (":true_light", ":true_maps"),
    "with the true color of the light against with the inferred light": (":true_color", ""),
    "with the true pattern of the light against with the inferred light": (":true_pattern", ""),
}


def light_transfer(results: Results, name: str) -> Numbers:
    """Compares relit pictures of figures that swap lights with the unchanged pictures, and with parts of the truth."""
    rows = gather([results.folder / name / "scores.csv"])
    networks = {row: trainings for row, trainings in rows.items() if ":" not in row and row not in transfer.BASELINES}
    heads = {"reconstruction_rmse": "relit, RMSE", "reconstruction_ssim": "relit, SSIM", "light_rmse": "light, RMSE"}
    by_column = {column: estimates(rows, column, networks, transfer.BASELINES) for column in heads}
    errors = by_column["reconstruction_rmse"]
    words = {
        f"{row}:{variant}" if variant else row: f"{label(row)}: {words}"
        for row in networks
        for variant, words in transfer.VARIANTS.items()
    } | transfer.BASELINES
    lines = [[said, *(by_column[column][predictor] for column in heads)] for predictor, said in words.items()]
    grid = TextTable.of(
        ["", *heads.values()], lines, kinds=["network" if row in networks else "baseline" for row in words]
    )
    comparisons = {}
    for row in networks:
        for what, pair in SWAPS.items():
            first, second = (errors[end if end in errors else f"{row}{end}"] for end in pair)
            comparisons[f"{label(row)} {what}"] = {"": compare_estimates("reconstruction_rmse", first, second)}
    correct([comparison for by_pair in comparisons.values() for comparison in by_pair.values()])
    any_scores = next(iter(rows.values()))[0]
    note = text("notes/light_transfer.md", pairs=len(any_scores.figures), swaps=len(any_scores.lights))
    return _section(results, name, {name: grid}, note) | {"comparisons": comparison_grid(comparisons)}


def traced(results: Results, name: str) -> Numbers:
    """Computes the errors of relit pictures against path tracing, and their causes."""
    path = results.folder / name / "scores.csv"
    note = text("notes/path_traced.md", scenes=pd.read_csv(path)["figure"].nunique())
    return _section(results, name, traced_tables(path), note)


def traced_tables(path: Path) -> dict[str, TextTable]:
    """Returns tables of the causes and the answers in a file of `evaluate_traced`; trainings of a row are averaged.

    Raises:
        UserError: if the file is not such a table.
    """
    table = read_table(path, "errors against path tracing", [*KEYS, *COLUMNS], "the stage path_traced")
    table["row"] = [TrainingName.parse(name).row for name in table["name"]]
    figures, values = table["figure"].nunique(), dict(list(table.groupby(["kind", "row"], sort=False)))
    networks = {row: label(row) for kind, row in values if kind == "answer" and row not in ANSWERS}
    causes = {f"network:{row}": f"{CAUSES['network']}: {words}" for row, words in networks.items()}
    causes |= {name: words for name, words in CAUSES.items() if name != "network"}

    def grid(kind: str, labels: dict[str, str]) -> TextTable:
        """Returns a grid with a row per name, in the order of `labels`."""
        rows, kinds = [], []
        for name in labels:
            if (kind, name) in values:
                numbers = values[kind, name][list(COLUMNS)].to_numpy().reshape(-1, figures, len(COLUMNS))
                in_percent = numbers * [1, 100, 100]  # the relative ones
                by_column = np.moveaxis(in_percent, -1, 0)[..., None]  # of trainings, figures, and one light each
                rows.append([labels[name], *map(estimate, by_column)])
                kinds.append("baseline" if name in ANSWERS else "network")
        heads, digits = ["", "RMSE", "relative, %", "mean, %"], {"RMSE": 4, "relative, %": 1, "mean, %": 1}
        return TextTable.of(heads, rows, kinds=kinds, digits=digits)

    return {
        "path_traced_causes": grid("cause", causes),
        "path_traced": grid("answer", {**networks, **ANSWERS}),
    }


def _section(results: Results, name: str, tables: dict[str, TextTable], note: str) -> Numbers:
    """Writes the tables of an experiment by the stems of their files, and returns its section with the plate."""
    for stem, grid in tables.items():
        write_tables(results.report / stem, results.title(name), note, grid)
    plate = results.folder / name / "plate.png", "Test figures under other lights, and the errors."
    return {"experiment": results.experiments[name], "note": note, "tables": tables, "plates": [plate]}


OWN: dict[str, Callable[[Results, str], Numbers]] = {
    "light_transfer": light_transfer,
    "path_traced": traced,
}
