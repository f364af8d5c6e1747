"""The report: what came out, a section per experiment, and what it was made from."""

from pathlib import Path

from relight import config
from relight.evaluation.claims import claims, listed, matrix, paragraph
from relight.evaluation.formats import count
from relight.evaluation.page import Section, build_page, fold, picture, prose
from relight.evaluation.plots import plot_curves, plot_errors
from relight.evaluation.report import data
from relight.evaluation.report.experiments import section
from relight.evaluation.report.results import Results


def build_report(name: str, settings: config.Evaluate, experiments: Path, folder: Path, out: Path) -> None:
    """Writes the page of the run `name` to `out`, with its pictures beside it; folder: results/<name>."""
    results = Results(folder, settings, experiments)
    compared = results.tables  # none where all experiments have stages of their own
    sections = [
        *([Section("What came out", verdict(results))] if compared else []),
        *(section(results, experiment) for experiment in results.experiments),
        *([Section("Training", training(results, out))] if compared else []),
        Section("Figures", data.figures(results)),
        Section("Lights", data.lights(results)),
        Section("Cost and settings", data.costs(results)),
    ]
    lead = (
        f"{count(len(results.record['figures']), 'figure')}, {count(len(results.runs), 'training')}; numbers were "
        "measured in this run, but for the rows called “as printed”, which are the paper's."
    )
    build_page(f"relight: {name}", sections, out, lead)


def verdict(results: Results) -> str:
    """Which of the paper's orderings hold here: how many, which, and with what numbers."""
    tables = [results.table(name) for name in results.tables if results.usual(name)]
    link = '<p><a href="viewer.html">Turn the light on the test figures with the mouse</a>'
    if not claims(tables):
        return prose(paragraph(tables)) + link
    return prose(paragraph(tables)) + matrix(tables) + link + fold("Every comparison in numbers", listed(tables))


def training(results: Results, out: Path) -> str:
    """Errors of the first table with their intervals, and the losses over the steps."""
    errors, curves = out.with_name("errors.png"), out.with_name("curves.png")
    table = results.table(results.tables[0])
    plot_errors(table, tuple(c for c in table.columns if c.endswith("rmse")), errors)
    plot_curves([results.folder / "train" / f"{run}.csv" for run in results.runs], curves)
    return picture(errors, "Errors with 95 % intervals over test figures.") + picture(curves, "Losses while training.")
