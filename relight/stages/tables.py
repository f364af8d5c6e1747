"""Tables 1 and 2 from the scores of all runs, as CSV, Markdown and LaTeX."""

from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage(
    "tables",
    runs="runs, one per line (.txt)",
    scores="folder of the runs' scores",
    baselines="the baselines' scores (.csv)",
    out="folder of the tables",
)
def main(evaluate: Evaluate, runs: Path, scores: Path, baselines: Path, out: Path) -> None:
    from relight.evaluation.formats import write_table

    for name, table in tables(evaluate, runs, scores, baselines).items():
        write_table(table, out / name)


def tables(evaluate: Evaluate, runs: Path, scores: Path, baselines: Path) -> dict:
    """The tables that the runs allow, by name."""
    from relight.evaluation.tables import gather, table1, table2

    rows = gather([scores / f"{run}.csv" for run in runs.read_text().split()])
    trivial = gather([baselines])
    made = {}
    if not all(row.startswith("no_") for row in rows):
        made["table1"] = table1(rows, trivial, evaluate)
    if any(row.startswith("no_") for row in rows):
        made["table2"] = table2(rows, trivial, evaluate)
    return made


if __name__ == "__main__":
    main.cli()
