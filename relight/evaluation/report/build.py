"""Builds the report: questions and outcome, a section per experiment, and provenance."""

from pathlib import Path
from typing import Any

from markupsafe import Markup

from relight.core.files import write_text
from relight.evaluation.report import page, sections
from relight.evaluation.report.provenance import provenance
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import compare_rows
from relight.evaluation.scoring.paper import CITATION
from relight.evaluation.scoring.statistics import MIN_SUBJECTS
from relight.evaluation.scoring.tables import PRINTED_TABLES, Table

TRUE_LIGHT = "shading_true_light_rmse"


def build_report(results: Results, out: Path) -> None:
    """Writes the page of a run and its charts; the section of an experiment that failed says what was not made.

    Raises:
        UserError: if a result is missing or broken.
    """
    outcome = sections.summary(results) if {*PRINTED_TABLES} & {*results.tables} else None
    parts = [_section("what-came-out", "What came out", "summary.md", outcome)] if outcome else []
    parts.append(_section("how-to-read", "How to read this page", "reading.md", {}))
    parts += [experiment(results, name) for name in results.experiments]
    for heading, make in sections.SECTIONS.items():
        anchor = heading.lower().replace(" ", "-")
        parts.append(_section(anchor, heading, f"{make.__name__}.md", make(results)))
    name = results.folder.name
    html = page.page("page.html", title=f"relight: {name}", head=head(name, results, outcome), sections=parts)
    write_text(out, html)


def experiment(results: Results, name: str) -> dict[str, Any]:
    """Makes the section of an experiment of the run by its name."""
    if failed := results.experiments[name].get("failed"):
        return _section(name, results.title(name), "failed.md", {"files": failed, "log": results.folder / "log"})
    return _section(name, results.title(name), "experiment.md", sections.experiment(results, name))


def _section(name: str, heading: str, template: str, numbers: dict[str, Any]) -> dict[str, Any]:
    """Makes a section of the page, its anchor, heading and content, from what its template in sections/ needs."""
    return {"name": name, "heading": heading, "html": page.section(f"sections/{template}", **numbers)}


def head(name: str, results: Results, outcome: dict[str, Any] | None) -> Markup:
    """Makes the head of the page: the paper, the questions, the outcome, and the provenance.

    `outcome` is the context of templates/sections/summary.md, if a table of the run is one that the paper prints.
    """
    tested = max((results.table(table).subjects for table in results.tables), default=0)
    with_plates = [table for table in results.tables if results.experiments[table]["plates"]]
    hero = next((results.report / f"{table}_overview.png" for table in with_plates), results.report / "figures.png")
    left_out = len(results.record["left_out"])
    return page.section(
        "head.md",
        title=f"relight: {name}",
        paper=CITATION,
        questions=[(name, results.title(name), about["question"]) for name, about in results.experiments.items()],
        outcome=outcome,
        answer=_answer(results),
        few=tested if 0 < tested < MIN_SUBJECTS else None,
        scans=results.run["settings"]["figures"]["source"] == "scans",
        left_out=left_out,
        failed=sum("failed" in about for about in results.experiments.values()),
        hero=hero if hero.exists() else None,
        overview=bool(with_plates),
        figures=len(results.record["figures"]) - left_out,
        lights=results.lights["lights"],
        trainings=len(results.trainings),
        steps=sorted({results.recipe(training)["train"]["steps"] for training in results.trainings}),
        origin=provenance(name, results.run),
    )


def _answer(results: Results) -> dict[str, Any] | None:
    """Returns the context of templates/answer.md: comparisons of the shading under the true light.

    `bar`: Ours plus with true normals and the mean AO; `constant`: with the mean training figure; `over_ao`: Ours
    (min) with SfSNet-AO, None without both. None if the experiment `claim` is not in the run, or lacks a row or test
    figures.
    """
    table = results.table("claim") if "claim" in results.tables else Table(())
    pairs = {"bar": ("ours_plus", "mean_occlusion"), "constant": ("ours_plus", "mean_figure")}
    pairs["over_ao"] = ("ours_min", "sfsnet_ao")
    columns = (TRUE_LIGHT, "relit_rmse")  # over which the table of comparisons corrects, too
    answer = {name: compare_rows(table, *pair, columns).get(TRUE_LIGHT) for name, pair in pairs.items()}
    return {"name": "claim", "scored": table, **answer} if answer["bar"] and table.subjects >= MIN_SUBJECTS else None
