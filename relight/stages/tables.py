"""Writes the tables of the experiments as CSV, Markdown and LaTeX."""

from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage

PICTURES = ("plates", "relit", "overview", "extremes")
SUFFIXES = (".csv", ".md", ".tex", *(f"_{kind}.png" for kind in PICTURES))  # of an experiment's files


@stage("tables", experiments="experiments (.json)", results="folder of the results", out="folder of the tables")
def main(evaluate: Evaluate, experiments: Path, results: Path, out: Path) -> None:
    """Writes the tables of all experiments, and removes files of experiments that are not in the plan."""
    from relight.evaluation.report.results import Results
    from relight.evaluation.report.sections import write_score_table

    made = Results(results, evaluate, experiments)
    for name in made.tables:
        write_score_table(made.table(name), made.title(name), out / name)
    for earlier in {path.stem for path in out.glob("*.tex")} - set(made.tables):
        for end in SUFFIXES:
            (out / f"{earlier}{end}").unlink(missing_ok=True)


if __name__ == "__main__":
    main.cli()
