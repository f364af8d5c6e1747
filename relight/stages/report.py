"""Writes the report, one page with all results of a run."""

from pathlib import Path

from relight.stages.stage import stage


@stage("report", experiments="experiments (.json)", results="folder of the results", out="report (.html)")
def main(name: str, experiments: Path, results: Path, out: Path) -> None:
    """Writes the page of the run `name` from its results (`relight.evaluation.report.build.build_report`)."""
    from relight.evaluation.report.build import build_report

    build_report(name, experiments, results, out)


if __name__ == "__main__":
    main.cli()
