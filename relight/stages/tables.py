"""Writes the tables of the experiments as CSV, Markdown and LaTeX."""

from pathlib import Path

from relight.stages.stage import stage


@stage("tables", experiments="experiments (.json)", results="folder of the results", out="folder of the tables")
def main(experiments: Path, results: Path, out: Path) -> None:
    """Writes the tables of all experiments."""
    from relight.evaluation.report.results import Results
    from relight.evaluation.report.sections import write_score_table

    made = Results(results, experiments)
    for name in made.tables:
        write_score_table(made.table(name), made.title(name), out / name)


if __name__ == "__main__":
    main.cli()
