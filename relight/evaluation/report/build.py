"""Builds the report: questions and outcome, a section per experiment, and provenance."""

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from markupsafe import Markup

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.evaluation.report import data, own, page, sections
from relight.evaluation.report.provenance import costs, provenance
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import compare_rows
from relight.evaluation.scoring.paper import CITATION
from relight.evaluation.scoring.tables import PRINTED, Table

T = TypeVar("T")
MIN_FIGURES = 5  # test figures, with fewer of which the first lines of the page draw no conclusion
# Endings of the files of an experiment.
PICTURES = ("errors", "plates", "relit", "overview")
FILE_ENDS = (".csv", ".md", *(f"_{kind}.png" for kind in PICTURES))


@dataclass
class Section:
    """A section of the page: its anchor, heading and content, which is the reason if it could not be made."""

    name: str
    heading: str
    html: Markup
    failed: bool = False


def build_report(results: Results, out: Path) -> None:
    """Writes the page of a run, its charts, and the tables of experiments with stages of their own.

    Tables and pictures of earlier runs with other experiments stay if the data set is still the same, and else are
    removed. A section that cannot be made gives the reason; the others are not affected.

    Args:
        results: of the run, whose folder has its name.
        out: the page (.html).

    Raises:
        UserError: if no section could be made.
    """
    folder, name = results.folder, results.folder.name
    remove_outdated(results)
    parts = []
    if _has_printed_tables(results):
        parts.append(_make("what-came-out", "What came out", "summary.md", lambda: sections.summary(results)))
    parts.append(Section("how-to-read", "How to read this page", page.section("sections/reading.md")))
    parts += [experiment(results, name) for name in results.experiments]
    if results.tables:
        parts.append(_make("training", "Training", "training.md", lambda: data.training(results)))
    parts += [
        _make("figures", "Figures", "figures.md", lambda: data.figures(results)),
        _make("lights", "Lights", "lights.md", lambda: data.lights(results)),
        _make("cost", "Cost", "costs.md", lambda: data.cost(results)),
    ]
    failed = sum(part.failed for part in parts)
    if failed == len(parts) - 1:  # all but the one that needs no results
        raise UserError(f"{folder}: no section of the report could be made; the reasons are above")
    html = page.page("page.html", title=f"relight: {name}", head=head(name, results, failed), sections=parts)
    with atomic_write(out) as tmp:
        tmp.write_text(html, encoding="utf-8")


def _has_printed_tables(results: Results) -> bool:
    """Returns whether a table of the run is one that the paper prints, so that its orderings can be tested."""
    return not set(PRINTED).isdisjoint(results.tables)


def remove_outdated(results: Results) -> None:
    """Removes the tables and pictures of earlier runs with other experiments if the data set has changed since."""
    data = [results.data / name for name in ("packed.safetensors", "lights/lights.npz")]
    changed = max((path.stat().st_mtime for path in data if path.exists()), default=0)
    for table in results.report.glob("*.md"):
        is_table = table.with_name(f"{table.stem}.csv").is_file()  # other files of a user stay
        is_planned = any(f"{table.stem}_".startswith(f"{name}_") for name in results.experiments)
        if is_table and not is_planned and table.stat().st_mtime < changed:
            for end in FILE_ENDS:
                table.with_name(f"{table.stem}{end}").unlink(missing_ok=True)


def experiment(results: Results, name: str) -> Section:
    """Makes the section of an experiment of the run by its name."""
    title = results.title(name)
    if failed := results.experiments[name].get("failed"):
        return _failed(
            name, title, f"Its jobs failed: {', '.join(failed)} was not made. {results.folder}/log says why."
        )
    make = own.OWN.get(name, sections.experiment)
    return _make(name, title, "experiment.md", lambda: make(results, name))


def _make(name: str, heading: str, template: str, numbers: Callable[[], dict]) -> Section:
    """Makes a section by its template in templates/sections from numbers; if either fails, one with the reason."""
    try:
        return Section(name, heading, page.section(f"sections/{template}", **numbers()))
    except Exception as error:  # of any kind, since the other sections must not be lost
        traceback.print_exc(file=sys.stderr)
        return _failed(name, heading, f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)


def _failed(name: str, heading: str, reason: str) -> Section:
    return Section(name, heading, page.section("sections/failed.md", reason=reason), failed=True)


def head(name: str, results: Results, failed: int) -> Markup:
    """Makes the head of the page: the paper, the questions, the outcome, and the provenance.

    Args:
        name: name of the run.
        results: results of the run.
        failed: number of sections that could not be made.
    """
    tested = _value_or_none(lambda: max(results.table(name).figures for name in results.readable)) or 0
    stage_costs, wall = costs(results.folder)
    with_plates = [table for table in results.tables if results.experiments[table]["plates"]]
    hero = next((results.report / f"{table}_overview.png" for table in with_plates), results.report / "figures.png")
    return page.section(
        "head.md",
        title=f"relight: {name}",
        paper=CITATION,
        questions=[(name, results.title(name), about["question"]) for name, about in results.experiments.items()],
        outcome=_value_or_none(lambda: sections.summary(results)) if _has_printed_tables(results) else None,
        answer=_value_or_none(lambda: _answer(results)),
        few=tested if 0 < tested < MIN_FIGURES else None,
        scans=results.run["settings"]["figures"]["source"] == "scans",
        left_out=_value_or_none(lambda: len(results.record["left_out"])),
        failed=failed,
        hero=hero if hero.exists() else None,
        overview=bool(with_plates),
        figures=_value_or_none(lambda: len(results.record["figures"]) - len(results.record["left_out"])),
        lights=_value_or_none(lambda: results.lights["lights"]),
        trainings=len(results.trainings),
        steps=_value_or_none(lambda: sorted({results.run["rows"][row]["train"]["steps"] for row in results.rows})),
        origin=provenance(results.folder),
        wall=wall,
        seconds=float(stage_costs.seconds.sum()),
    )


def _answer(results: Results) -> dict[str, Any] | None:
    """Returns the context of templates/answer.md: transport against normals by column, and in `over_ao` with AO.

    None if the experiment `claim` is not in the run or lacks a row.
    """
    table = results.table("claim") if "claim" in results.tables else Table(())
    claims = compare_rows(table, "ours_min", "sfsnet", ("shading_true_light_rmse", "relit_rmse"))
    over_ao = compare_rows(table, "ours_min", "sfsnet_ao", ("shading_true_light_rmse",))
    context = {"name": "claim", "claims": claims, "over_ao": next(iter(over_ao.values()), None), "scored": table}
    return context if len(claims) == 2 else None


def _value_or_none(make: Callable[[], T]) -> T | None:
    """Returns what a function returns, or None if it fails; the section with these numbers gives the reason."""
    try:
        return make()
    except Exception:
        return None
