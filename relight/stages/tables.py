"""The tables of the experiments from the scores of their runs, as CSV, Markdown and LaTeX."""

import json
from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage(
    "tables",
    experiments="experiments (.json)",
    scores="folder of the runs' scores",
    baselines="the baselines' scores (.csv)",
    out="folder of the tables",
)
def main(evaluate: Evaluate, experiments: Path, scores: Path, baselines: Path, out: Path) -> None:
    from relight.evaluation.formats import write_table

    for name, table in tables(evaluate, experiments, scores, baselines).items():
        write_table(table, out / name)


def tables(evaluate: Evaluate, experiments: Path, scores: Path, baselines: Path) -> dict:
    """The table of each experiment that is one, by name."""
    from relight.evaluation.tables import experiment_table, gather

    asked = {name: one for name, one in json.loads(experiments.read_text()).items() if one["table"]}
    runs = dict.fromkeys(run for one in asked.values() for runs in one["runs"].values() for run in runs)
    rows = gather([scores / f"{run}.csv" for run in runs])
    trivial = gather([baselines])
    return {
        name: experiment_table(name, {row: rows[row] for row in one["runs"]}, trivial, evaluate, rows)
        for name, one in asked.items()
    }


if __name__ == "__main__":
    main.cli()
