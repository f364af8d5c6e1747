"""Computes the numbers of the report's section about the benchmark, and writes its tables."""

from typing import Any

from relight.benchmark.methods import BASELINES, FIXED
from relight.benchmark.score import mean_scores, read_scores
from relight.benchmark.tables import MethodComparison
from relight.evaluation.report.formats import write_tables
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.labels import label


def benchmark(results: Results, name: str) -> dict[str, Any]:
    """Compares the networks of a run, the weights that ship with relight, and the baselines.

    Args:
        results: results of the run.
        name: name of the experiment.

    Returns:
        The context of templates/sections/experiments/benchmark.md.

    Raises:
        UserError: if scores are missing, or were made on different sets.
    """
    experiment = results.experiments[name]
    rows = {**experiment["trainings"], **{method: [method] for method in FIXED}}
    scored = [
        mean_scores(label(row), [read_scores(results.folder / "benchmark_scores" / method) for method in methods])
        for row, methods in rows.items()
    ]
    kinds = {label(row): "baseline" if row in BASELINES else "network" for row in rows}
    tables = MethodComparison(scored, list(rows).index("shipped")).tables()
    for stem, table in tables.items():
        table.grid.kinds = [kinds.get(words, "") for words in table.grid.frame.index]  # the last table has measures
        write_tables(results.report / stem, table.title, table.note, table.grid)
    return {"experiment": experiment, "trainings": max(map(len, experiment["trainings"].values())), "tables": tables}
