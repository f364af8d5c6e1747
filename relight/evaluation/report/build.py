"""Builds the report: questions and outcome, a section per experiment, and provenance."""

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from markupsafe import Markup

from relight.errors import UserError
from relight.evaluation.report import data, own, page, sections
from relight.evaluation.report.formats import TextTable
from relight.evaluation.report.provenance import costs, provenance
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import compare_rows
from relight.evaluation.scoring.paper import CITATION, CONTENTS
from relight.evaluation.scoring.tables import PRINTED
from relight.files import atomic_write

T = TypeVar("T")

# Endings of the files of an experiment.
FILE_ENDS = (".csv", ".md", ".tex", *(f"_{kind}.png" for kind in ("plates", "relit", "overview", "extremes")))


@dataclass
class Section:
    """A section of the page.

    Attributes:
        name: anchor.
        heading: heading of the section.
        html: content.
        failed: whether it could not be made; the content then is the reason.
    """

    name: str
    heading: str
    html: Markup
    failed: bool = False


def build_report(name: str, experiments: dict[str, dict[str, Any]], folder: Path, out: Path) -> None:
    """Writes the page of a run, its charts, and the tables of experiments with stages of their own.

    Tables and pictures of earlier runs with other experiments stay if the data set is still the same, and else are
    removed. A section that cannot be made gives the reason; the others are not affected.

    Args:
        name: name of the run.
        experiments: the experiments of the run (`relight.lab.plan.Plan.described`).
        folder: results/<name>.
        out: the page (.html).

    Raises:
        UserError: if no section could be made.
    """
    results = Results(folder, experiments)
    remove_outdated(results)
    parts = []
    if has_printed_tables(results):
        parts.append(make_section("what-came-out", "What came out", "summary.md", sections.summary, results))
    parts.append(Section("how-to-read", "How to read this page", page.section("sections/reading.md")))
    parts += [experiment(results, name) for name in results.experiments]
    if results.tables:
        parts.append(make_section("training", "Training", "training.md", data.training, results))
    parts += [
        make_section("figures", "Figures", "figures.md", data.figures, results),
        make_section("lights", "Lights", "lights.md", data.lights, results),
        Section("the-paper", "The paper, part by part", page.section("sections/paper.md", grid=contents(results))),
        make_section("cost-and-settings", "Cost and settings", "costs.md", data.costs_and_settings, results),
    ]
    failed = sum(part.failed for part in parts)
    if failed == len(parts) - 2:  # all but the two that need no results
        raise UserError(f"{folder}: no section of the report could be made; the reasons are above")
    html = page.page("page.html", title=f"relight: {name}", head=head(name, results, failed), sections=parts)
    with atomic_write(out) as tmp:
        tmp.write_text(html, encoding="utf-8")


def has_printed_tables(results: Results) -> bool:
    """Returns whether a table of the run is one that the paper prints, so that its orderings can be tested."""
    return not set(PRINTED).isdisjoint(results.tables)


def remove_outdated(results: Results) -> None:
    """Removes the tables and pictures of earlier runs with other experiments if the data set has changed since."""
    data = [results.folder / name for name in ("packed.safetensors", "lights/lights.npz")]
    changed = max((path.stat().st_mtime for path in data if path.exists()), default=0)
    planned = tuple(results.experiments)
    for table in results.report.glob("*.tex"):
        is_planned = any(table.stem == name or table.stem.startswith(f"{name}_") for name in planned)
        if not is_planned and table.stat().st_mtime < changed:
            for end in FILE_ENDS:
                table.with_name(f"{table.stem}{end}").unlink(missing_ok=True)


def experiment(results: Results, name: str) -> Section:
    """Makes the section of an experiment.

    Args:
        results: results of the run.
        name: name of the experiment.
    """
    if failed := results.experiments[name].get("failed"):
        missing = ", ".join(failed)
        return failed_section(
            name, results.title(name), f"Its jobs failed: {missing} was not made. {results.folder}/log says why."
        )
    make = own.OWN.get(name, sections.experiment)
    template = f"experiments/{name}.md" if page.exists(f"sections/experiments/{name}.md") else "experiment.md"
    return make_section(name, results.title(name), template, lambda results: make(results, name), results)


def make_section(
    name: str, heading: str, template: str, numbers: Callable[[Results], dict], results: Results
) -> Section:
    """Makes a section from its numbers and its template; if either fails, a section with the reason.

    Args:
        name: anchor.
        heading: heading of the section.
        template: file in templates/sections.
        numbers: computes the context of the template.
        results: results of the run, from which it does.
    """
    try:
        return Section(name, heading, page.section(f"sections/{template}", **numbers(results)))
    except Exception as error:  # of any kind, since the other sections must not be lost
        traceback.print_exc(file=sys.stderr)
        return failed_section(name, heading, f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)


def failed_section(name: str, heading: str, reason: str) -> Section:
    """Makes a section with the reason why it could not be made."""
    return Section(name, heading, page.section("sections/failed.md", reason=reason), failed=True)


def contents(results: Results) -> TextTable:
    """Returns the paper's figures and tables, linked to the sections of this run, and the commands that repeat them."""
    anchors = {*results.experiments, "figures", "lights", *(["training"] if results.tables else [])}
    rows = [
        [
            Markup('<a href="#{}">{}</a>').format(anchor, what) if anchor in anchors else what,
            shows,
            Markup("<code>{}</code>").format(command),
        ]
        for what, shows, anchor, command in CONTENTS
    ]
    return TextTable.of(["the paper's", "shows", "command"], rows)


def head(name: str, results: Results, failed: int) -> Markup:
    """Makes the head of the page: the paper, the questions, the outcome, and the provenance.

    Args:
        name: name of the run.
        results: results of the run.
        failed: number of sections that could not be made.
    """
    outcome = value_or_none(lambda: sections.summary(results)) if has_printed_tables(results) else None
    answer = value_or_none(lambda: answer_context(results))
    lights = value_or_none(lambda: results.lights["lights"])
    figures = value_or_none(lambda: len(results.record["figures"]) - len(results.record["left_out"]))
    rows = {row for table in results.tables for row in results.experiments[table]["trainings"]}
    steps = value_or_none(lambda: sorted({results.setting(row, "train.steps") for row in rows}))
    stage_costs, wall = costs(results.folder)
    with_plates = [table for table in results.tables if results.experiments[table]["plates"]]
    hero = next((results.report / f"{table}_overview.png" for table in with_plates), results.report / "figures.png")
    questions = [(name, results.title(name), about["question"]) for name, about in results.experiments.items()]
    return page.section(
        "head.md",
        title=f"relight: {name}",
        paper=CITATION,
        questions=questions,
        outcome=outcome,
        answer=answer,
        scans=any(settings.get("figures.source") == "scans" for settings in results.settings_files().values()),
        left_out=value_or_none(lambda: len(results.record["left_out"])),
        failed=failed,
        hero=hero if hero.exists() else None,
        overview=bool(with_plates),
        figures=figures,
        lights=lights,
        trainings=len(results.trainings),
        steps=steps,
        origin=provenance(results.folder),
        wall=wall,
        seconds=float(stage_costs.seconds.sum()),
    )


def answer_context(results: Results) -> dict[str, Any] | None:
    """Compares transport with normals, with and without AO, for the first lines of the page.

    Returns:
        The context of templates/answer.md. `claims`: Ours (min) against SfSNet by column; `over_ao`: against SfSNet-AO
        in shading, or None. None if the experiment `claim` is not in the run or lacks a row.
    """
    if "claim" not in results.tables:
        return None
    table = results.table("claim")
    claims = compare_rows(table, "ours_min", "sfsnet", ("shading_true_light_rmse", "relit_rmse"))
    over_ao = compare_rows(table, "ours_min", "sfsnet_ao", ("shading_true_light_rmse",))
    context = {"name": "claim", "claims": claims, "over_ao": next(iter(over_ao.values()), None), "scored": table}
    return context if len(claims) == 2 else None


def value_or_none(make: Callable[[], T]) -> T | None:
    """Returns what a function returns, or None if it fails; the section with these numbers gives the reason."""
    try:
        return make()
    except Exception:
        return None
