"""The tables of the experiments from the scores of their runs, as CSV, Markdown and LaTeX."""

from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage("tables", experiments="experiments (.json)", results="folder of the results", out="folder of the tables")
def main(evaluate: Evaluate, experiments: Path, results: Path, out: Path) -> None:
    from relight.evaluation.formats import write_table
    from relight.evaluation.report.results import Results

    made = Results(results, evaluate, experiments)
    for name in made.tables:
        write_table(made.table(name), out / name)
    # Tables of earlier experiments, which the report does not tell of.
    for earlier in {path.stem for path in out.glob("*.tex")} - set(made.tables):
        for end in (".csv", ".md", ".tex", "_plates.png"):
            (out / f"{earlier}{end}").unlink(missing_ok=True)


if __name__ == "__main__":
    main.cli()
