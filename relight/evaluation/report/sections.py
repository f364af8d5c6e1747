"""Makes the sections: each function returns the context of a template in templates/sections, and draws its chart."""

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from relight.evaluation.pictures import charts
from relight.evaluation.report import formats
from relight.evaluation.report.formats import TextTable
from relight.evaluation.report.page import text
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import Comparison, Verdict, compare_rows, correct, orderings
from relight.evaluation.scoring.tables import Table
from relight.settings.scores import column_label, label

DAGGER = " †"  # marks printed differences that are under MARGIN
# Of an ordering of the paper in this run.
OUTCOMES = {Verdict.BETTER: "holds", Verdict.WORSE: "reversed", Verdict.EQUIVALENT: "equivalent", Verdict.OPEN: "open"}
PLATES = {  # pictures of an experiment, by the ends of their files
    "plates": "Test figures: the truth, and the inference of each network.",
    "swapped": "Two people in two lights, each relit by the light inferred from the other's picture.",
    "relit": "A test figure relit by test lights: the truth, and each network's result from the first picture alone.",
}
Numbers = dict[str, Any]


def experiment(results: Results, name: str) -> Numbers:
    """Returns the context of templates/sections/experiment.md, and draws the chart.

    `usual` is the table on the usual figures and lights if the experiment has others.
    """
    table, settings = results.table(name), results.experiments[name]
    numbers: Numbers = {"experiment": settings, "note": text("note.md", scored=table), "tables": {}}
    if not table.rows:
        return numbers
    usual = None if results.usual(name) else results.table(name, usual=True)
    compared = _compare_pairs(table, settings, usual)
    files = {kind: results.report / f"{name}_{kind}.png" for kind in ("errors", *PLATES)}
    charts.plot_errors(table, list(results.run["rows"]), files["errors"])
    comparisons = formats.comparison_grid(compared)
    if compared:
        title = f"{results.title(name)}: comparisons"
        formats.write_tables(results.report / f"{name}_compared", title, text("note.md", scored=table), comparisons)
    return numbers | {
        "scored": table,
        "usual": usual,
        "comparisons": comparisons,
        "unlearned": _unlearned(table, tuple(settings["compare_in"])),
        "chart": files["errors"],
        "tables": {name: formats.score_grid(table, table.columns)},
        "others": formats.score_grid(table, formats.other_columns(table)),
        "plates": [(files[kind], words) for kind, words in PLATES.items() if settings["plates"]],
    }


def _unlearned(table: Table, columns: tuple[str, ...]) -> dict[str, list[str]]:
    """Returns the networks that are no better than the mean training figure, a constant, by column."""
    unlearned: dict[str, list[str]] = {}
    for row in table.networks:
        for column, comparison in compare_rows(table, row, "mean_figure", columns).items():
            if comparison.verdict is not Verdict.BETTER:
                unlearned.setdefault(column_label(column), []).append(table.label(row))
    return unlearned


def write_score_table(table: Table, title: str, stem: Path) -> None:
    """Writes the table of an experiment as CSV (all columns) and Markdown, to a path without suffix.

    Without rows, as of sitting figures where nobody sits, the files say so.
    """
    if table.rows:
        shown, others = (formats.score_grid(table, each) for each in (table.columns, formats.other_columns(table)))
    else:
        shown, others = TextTable.of(["row", "nothing to compare"], []), None
    formats.write_tables(stem, title, text("note.md", scored=table), shown, table.statistics(), others)


def _compare_pairs(table: Table, settings: dict[str, Any], usual: Table | None) -> dict[str, dict[str, Comparison]]:
    """Compares the pairs in an experiment's settings, without those of which the table lacks a row.

    Without pairs, as in a sweep, the best network in the first column is compared with the others. If there is a table
    on the `usual` figures and lights, the pairs are compared there, too, and each network with itself. Returns what is
    compared, in words -> column -> comparison.
    """
    columns, compared, asked = tuple(settings["compare_in"]), {}, settings["compare"]
    pairs = {pair: asked[pair] for pair in asked if table.rows.keys() >= {*pair.split(" against ")}}
    if not pairs and columns:
        columns, rows = columns[:1], table.networks
        best = next((row for row in rows if (cell := table.rows[row].get(columns[0])) and cell.best), "")
        pairs = {f"{best} against {row}": f"best {column_label(columns[0])}" for row in rows if row != best}
    others = " and ".join(f"{settings[what]} {what}" for what in ("figures", "lights") if settings[what] != "test")
    for row in table.networks if usual else ():
        compared[f"{table.label(row)}, {others} against usual ones"] = compare_rows(table, row, row, columns, usual)
    for pair, measures in pairs.items():
        first, _, second = pair.partition(" against ")
        words = f"{table.label(first)} against {table.label(second)}: {measures}"
        compared[words] = compare_rows(table, first, second, columns)
        if usual:
            compared[f"{words} (usual ones)"] = compare_rows(usual, first, second, columns)
    if len(columns) == 1:
        correct([comparison for by_column in compared.values() for comparison in by_column.values()])
    return {words: by_column for words, by_column in compared.items() if by_column}


def summary(results: Results) -> Numbers:
    """Returns the context of templates/sections/summary.md: which of the paper's orderings hold in this run."""
    tables = [table for name in results.tables if results.usual(name) and (table := results.table(name)).rows]
    tested, own = orderings(tables), results.experiments.values()
    counts = [count for table in tables for count in table.trainings.values()]
    lines = [
        [
            f"{label(ordering.better, own)} before {label(ordering.worse, own)}",
            column_label(ordering.comparison.column),
            f"{100 * ordering.printed_difference:.1f} %{DAGGER * ordering.below_margin}{' *' * (not ordering.argued)}",
            *formats.effect(ordering.comparison),
            *(formats.number(value) for value in (ordering.comparison.first, ordering.comparison.second)),
            formats.p_value(ordering.comparison.p),
            f"{formats.SIGNS[ordering.comparison.verdict]} {OUTCOMES[ordering.comparison.verdict]}",
            formats.bound(ordering.comparison),
        ]
        for ordering in tested
    ]
    heads = ["the paper prints", "in", "by", "here by", "interval", "first", "second", "p", "here", "within"]
    return {
        "tables": tables,
        "orderings": tested,
        "verdicts": Counter(ordering.comparison.verdict for ordering in tested),
        "small": sum(ordering.below_margin for ordering in tested),
        "trainings": (min(counts, default=0), max(counts, default=0)),
        "listed": TextTable.of(heads, lines),
    }


def figures(results: Results) -> Numbers:
    """Computes the numbers of the section about the figures."""
    infos, left_out = results.record["figures"], results.record["left_out"]
    repairs = {name: _counted(info["repairs"]) for name, info in infos.items() if info.get("repairs")}
    warnings: dict[str, list[str]] = {}  # names of figures by warning
    for name, info in infos.items():
        for warning in info.get("warnings", ()):
            warnings.setdefault(warning, []).append(name)
    return {
        "infos": infos,
        "left_out": _two_columns(["left out", "reason"], left_out),
        "sheet": results.report / "figures.png",
        "repairs": _two_columns(["figure", "repairs"], repairs),
        "warnings": warnings,
    }


def lights(results: Results) -> Numbers:
    """Computes the numbers of the section about the lights."""
    from relight.lights import read_light_set

    record, chosen = results.lights, read_light_set(results.data / "lights")
    steps = [[step["step"], step["in"], step["out"], _counted(step["why"])] for step in record["steps"]]
    return {
        "counts": record["lights"],
        "sources": len(set(chosen.of("test").source)),
        "warnings": record["warnings"],
        "steps": TextTable.of(["step", "lights in", "out", "dropped (a light may have several reasons)"], steps),
        "sheet": results.report / "lights.png",
        "csv": os.path.relpath(results.data / "lights" / "lights.csv", results.report),
        "unlit": _two_columns(["panorama", "rules broken"], record["unlit"]),
        "unreadable": _two_columns(["file", "reason"], record["unreadable"]),
        "repaired": _two_columns(["file", "how"], record["repaired"]),
    }


# What follows the experiments on the page, by heading; a function's template has its name, in templates/sections.
SECTIONS: dict[str, Callable[[Results], Numbers]] = {"Figures": figures, "Lights": lights}


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{what} {count}" for what, count in counts.items() if count)


def _two_columns(heads: list[str], pairs: dict[str, str]) -> TextTable:
    return TextTable.of(heads, [list(item) for item in pairs.items()])
