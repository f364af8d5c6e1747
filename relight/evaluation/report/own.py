"""Computes the numbers of experiments that are not tables of trainings, and writes their tables."""

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
from relight.evaluation.scoring.comparisons import Comparison, Verdict, compare_estimates, correct
from relight.evaluation.scoring.labels import label
from relight.evaluation.scoring.scores import gather, read_table
from relight.evaluation.scoring.statistics import estimate
from relight.evaluation.scoring.tables import estimates
from relight.training_name import TrainingName

Numbers = dict[str, Any]
PARTS = ("color", "pattern")  # of a light, which light transfer exchanges separately


def light_transfer(results: Results, name: str) -> Numbers:
    """Compares relit pictures of figures that swap lights with the unchanged pictures.

    Args:
        results: results of the run.
        name: name of the experiment.

    Returns:
        The context of templates/sections/experiments/light_transfer.md, among it:
        `costly`: row -> "maps" or "light", whichever has the larger error, or None if the difference is not
        significant.
        `worse`: row -> the parts of the light that make its pictures worse if they are replaced by the true ones.
    """
    rows = gather([results.folder / "light_transfer" / "scores.csv"])
    networks = {row: trainings for row, trainings in rows.items() if ":" not in row and row not in transfer.BASELINES}
    heads = {"reconstruction_rmse": "relit, RMSE", "reconstruction_ssim": "relit, SSIM", "light_rmse": "light, RMSE"}
    by_column = {c: estimates(rows, c, networks, transfer.BASELINES) for c in heads}

    def compare(first: str, second: str) -> Comparison:
        """Compares the errors of relit pictures of two predictors, without correction."""
        errors = by_column["reconstruction_rmse"]
        return compare_estimates("reconstruction_rmse", errors[first], errors[second])

    lines, kinds, comparisons, costly, worse = [], [], {}, {}, {}
    for row in networks:
        for variant, words in transfer.VARIANTS.items():
            predictor = f"{row}:{variant}" if variant else row
            lines.append([f"{label(row)}: {words}", *(by_column[column][predictor] for column in heads)])
            kinds.append("baseline" if variant else "network")
        others = {"the picture as it is": "as_it_is", "its own maps under the mean light": f"{row}:mean_light"}
        for words, other in others.items():
            comparisons[f"{label(row)} against {words}"] = {"": compare(row, other)}
        parts = compare(f"{row}:true_light", f"{row}:true_maps")
        costly[row] = {Verdict.WORSE: "maps", Verdict.BETTER: "light"}.get(parts.verdict)
        worse[row] = [part for part in PARTS if compare(f"{row}:true_{part}", row).verdict is Verdict.WORSE]
    for trivial, words in transfer.BASELINES.items():
        lines.append([words, *(by_column[column][trivial] for column in heads)])
        kinds.append("baseline")
    correct([comparison for group in comparisons.values() for comparison in group.values()])
    grid = TextTable.of(["", *heads.values()], lines, kinds)
    any_scores = next(iter(rows.values()))[0]
    made = {
        "grid": grid,
        "pairs": len(any_scores.figures),
        "swaps": len(any_scores.lights),
        "costly": costly,
        "worse": worse,
        "comparisons": comparison_grid(comparisons),
        "plate": results.folder / "light_transfer" / "plate.png",
    }
    return write_grids(results, name, {name: grid}, made)


def traced(results: Results, name: str) -> Numbers:
    """Computes the errors of relit pictures against path tracing, and their causes.

    Args:
        results: results of the run.
        name: name of the experiment.

    Returns:
        The context of templates/sections/experiments/path_traced.md. `answers` and `networks`: relative errors in
        percent; `largest`: cause -> RMSE, the largest first; `scenes`: number of traced figures.
    """
    path = results.folder / "path_traced" / "scores.csv"
    tables = traced_tables(path)
    answers = {row: float(estimate.mean) for row, estimate in tables["path_traced"].frame["relative, %"].items()}
    rmse = {row: estimate.mean for row, estimate in tables["path_traced_causes"].frame["RMSE"].items()}
    causes = [cause for cause in rmse if cause in CAUSES.values()]
    largest = sorted(causes, key=lambda cause: rmse[cause], reverse=True)
    numbers = {
        "tables": tables,
        "scenes": pd.read_csv(path)["figure"].nunique(),
        "answers": {key: answers[label] for key, label in ANSWERS.items()},
        "networks": {row: value for row, value in answers.items() if row not in ANSWERS.values()},
        "largest": {cause: rmse[cause] for cause in largest},
        "plate": results.folder / "path_traced" / "plate.png",
    }
    return write_grids(results, name, tables, numbers)


def traced_tables(path: Path) -> dict[str, TextTable]:
    """Returns tables of the answers and the causes of `path_traced.evaluate_traced`; trainings of a row are averaged.

    Args:
        path: the file (.csv).

    Returns:
        The tables `path_traced_causes` and `path_traced`.

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
        return TextTable.of(heads, rows, kinds, digits)

    return {
        "path_traced_causes": grid("cause", causes),
        "path_traced": grid("answer", {**networks, **ANSWERS}),
    }


def write_grids(results: Results, name: str, grids: dict[str, TextTable], made: Numbers) -> Numbers:
    """Writes the tables of an experiment, and returns the context of its section.

    Args:
        results: results of the run.
        name: name of the experiment, and of its note in templates/notes.
        grids: stem of the files -> table.
        made: the numbers of the section, also for the note.
    """
    experiment = results.experiments[name]
    for stem, grid in grids.items():
        write_tables(results.report / stem, results.title(name), text(f"notes/{name}.md", **made), grid)
    return {"name": name, "experiment": experiment, **made}


OWN: dict[str, Callable[[Results, str], Numbers]] = {
    "light_transfer": light_transfer,
    "path_traced": traced,
}
