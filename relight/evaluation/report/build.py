"""The report: questions and outcome, a section per experiment, and what it was made from."""

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from markupsafe import Markup

from relight import config
from relight.evaluation.formats import Grid
from relight.evaluation.paper import CITATION, CONTENTS
from relight.evaluation.report import data, own, page, sections
from relight.evaluation.report.provenance import costs, provenance
from relight.evaluation.report.results import Results
from relight.files import UserError, atomic_write

T = TypeVar("T")


@dataclass
class Part:
    """A section: its anchor, its heading, and its HTML; `failed`: it could not be made, and its HTML says why."""

    name: str
    heading: str
    html: Markup
    failed: bool = False


def build_report(name: str, settings: config.Evaluate, experiments: Path, folder: Path, out: Path) -> None:
    """Writes the page of a run, and beside it its charts and the tables of experiments with stages of their own.

    A section that cannot be made says so, and takes no other along.

    Args:
        name: of the run.
        settings: how many resamples, their seed, how many figures the sheets show.
        experiments: the experiments of the run (experiments.json, `Plan.requested`).
        folder: results/<name>.
        out: the page (.html).

    Raises:
        UserError: no section could be made.
    """
    results = Results(folder, settings, experiments)
    compared = bool(results.tables)  # none where all experiments have stages of their own
    made = [
        *([part("what-came-out", "What came out", "summary.md", sections.summary, results)] if compared else []),
        Part("how-to-read", "How to read this page", page.section("sections/reading.md")),
        *(experiment(results, one) for one in results.experiments),
        *([part("training", "Training", "training.md", data.training, results)] if compared else []),
        part("figures", "Figures", "figures.md", data.figures, results),
        part("lights", "Lights", "lights.md", data.lights, results),
        Part("the-paper", "The paper, part by part", page.section("sections/paper.md", grid=contents(results))),
        part("cost-and-settings", "Cost and settings", "costs.md", data.costs_and_settings, results),
    ]
    failed = sum(one.failed for one in made)
    if failed == len(made) - 2:
        raise UserError(f"{folder}: no section of the report could be made; the reasons are above")
    html = page.page("page.html", title=f"relight: {name}", head=head(name, results, failed), sections=made)
    with atomic_write(out) as tmp:
        tmp.write_text(html, encoding="utf-8")


def experiment(results: Results, name: str) -> Part:
    """The section of an experiment."""
    one = results.experiments[name]
    if one.get("failed"):
        missing = ", ".join(one["failed"])
        return failure(
            name, results.title(name), f"Its jobs failed: {missing} was not made. {results.folder}/log says why."
        )
    make = own.OWN.get(name, sections.experiment)
    template = f"{name}.md" if name in own.OWN or name in sections.EXPERIMENTS else "experiment.md"
    return part(name, results.title(name), template, lambda results: make(results, name), results)


def part(name: str, heading: str, template: str, numbers: Callable[[Results], dict], results: Results) -> Part:
    """A section from its numbers and its words; when either fails, one that says why."""
    try:
        return Part(name, heading, page.section(f"sections/{template}", **numbers(results)))
    except Exception as error:  # whatever it is: the other sections must not be lost
        traceback.print_exc(file=sys.stderr)
        return failure(name, heading, f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)


def failure(name: str, heading: str, reason: str) -> Part:
    """A section that says why it could not be made."""
    return Part(name, heading, page.section("sections/failed.md", reason=reason), failed=True)


def contents(results: Results) -> Grid:
    """The paper's figures and tables, those that this run answers as links to their sections, and the commands."""
    there = {*results.experiments, "figures", "lights", *(["training"] if results.tables else [])}
    rows = [
        [
            Markup('<a href="#{}">{}</a>').format(anchor, what) if anchor in there else what,
            shows,
            Markup("<code>{}</code>").format(command),
        ]
        for what, shows, anchor, command in CONTENTS
    ]
    return Grid.of(["the paper's", "shows", "command"], rows)


def head(name: str, results: Results, failed: int) -> Markup:
    """The first screen: the questions, the paper, the outcome, and where this page comes from."""
    outcome = attempt(lambda: sections.summary(results))
    lights = attempt(lambda: results.lights["lights"])
    figures = attempt(lambda: len(results.record["figures"]))
    rows = {row for one in results.tables for row in results.experiments[one]["runs"]}
    steps = attempt(lambda: sorted({results.setting(row, "train.steps") for row in rows}))
    found, wall = costs(results.folder)
    shown = [one for one in results.tables if results.experiments[one]["plates"]]
    hero = next((results.report / f"{one}_overview.png" for one in shown), results.report / "figures.png")
    questions = [(one, results.title(one), about["question"]) for one, about in results.experiments.items()]
    return page.section(
        "head.md",
        title=f"relight: {name}",
        paper=CITATION,
        questions=questions,
        outcome=outcome,
        failed=failed,
        hero=hero if hero.exists() else None,
        overview=bool(shown),
        figures=figures,
        lights=lights,
        trainings=len(results.runs),
        steps=steps,
        origin=provenance(results.folder),
        wall=wall,
        seconds=float(found.seconds.sum()),
    )


def attempt(make: Callable[[], T]) -> T | None:
    """What `make` returns; None where it fails, since a section of its own says why."""
    try:
        return make()
    except Exception:
        return None
