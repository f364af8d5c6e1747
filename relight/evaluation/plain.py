"""Plain tables of words and estimates, for experiments that are no table of trainings: CSV, Markdown, LaTeX, HTML."""

import csv
import io
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from relight.evaluation.statistics import Estimate
from relight.files import whole

SPECIAL = str.maketrans({"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "×": r"$\times$", "²": "$^2$", "–": "--"})

Value = str | int | float | Estimate | None  # None leaves the cell blank


@dataclass
class Plain:
    """heads: column -> decimals of its numbers (None: words or whole numbers); rows: a value per column; italic: the
    rows, by place, that are set apart."""

    title: str
    heads: dict[str, int | None]
    rows: list[list[Value]]
    legend: str
    italic: frozenset[int] = frozenset()


def write_plain(table: Plain, stem: Path) -> list[Path]:
    """Writes stem.csv, stem.md and stem.tex, each whole or not at all; returns their paths."""
    paths = []
    for suffix, text in (("csv", plain_csv), ("md", plain_markdown), ("tex", plain_latex)):
        paths.append(stem.with_suffix(f".{suffix}"))
        with whole(paths[-1]) as tmp:
            tmp.write_text(text(table), encoding="utf-8")
    return paths


def shown(value: Value, digits: int | None) -> str:
    """A cell as text: an estimate with half its 95 % interval, which is infinite where one figure is all there is."""
    if value is None:
        return ""
    if isinstance(value, Estimate):
        margin = f"{value.margin:.{digits}f}" if np.isfinite(value.margin) else "∞"
        return f"{value.mean:.{digits}f} ± {margin}"
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def plain_csv(table: Plain) -> str:
    """Estimates take three columns: mean, low, high."""
    estimated = {i for row in table.rows for i, value in enumerate(row) if isinstance(value, Estimate)}
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    heads = [
        [head, f"{head}, low", f"{head}, high"] if i in estimated else [head] for i, head in enumerate(table.heads)
    ]
    writer.writerow([head for group in heads for head in group])
    for row in table.rows:
        cells: list[str] = []
        for i, value in enumerate(row):
            if isinstance(value, Estimate):
                cells += [f"{number:.6g}" for number in (value.mean, value.low, value.high)]
            else:
                text = "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
                cells += [text] + ["", ""] * (i in estimated)
        writer.writerow(cells)
    return out.getvalue()


def texts(table: Plain) -> list[list[str]]:
    return [[shown(value, digits) for value, digits in zip(row, table.heads.values())] for row in table.rows]


def plain_markdown(table: Plain) -> str:
    right = ["---:" if digits is not None else "---" for digits in table.heads.values()]
    lines = [f"## {table.title}", "", table.legend, "", f"| {' | '.join(table.heads)} |", f"|{'|'.join(right)}|"]
    for place, cells in enumerate(texts(table)):
        first = f"*{cells[0]}*" if place in table.italic else cells[0]
        lines.append(f"| {' | '.join([first, *cells[1:]])} |")
    return "\n".join([*lines, ""])


def plain_latex(table: Plain) -> str:
    """A tabular (package booktabs)."""
    sides = "".join("l" if digits is None else "r" for digits in table.heads.values())
    lines = [
        f"% {table.title}. Needs \\usepackage{{booktabs}}.",
        f"% {table.legend}".replace("\n", " "),
        f"\\begin{{tabular}}{{{sides}}}",
        "\\toprule",
        " & ".join(head.translate(SPECIAL) for head in table.heads) + " \\\\",
        "\\midrule",
    ]
    for place, cells in enumerate(texts(table)):
        cells = [cell.translate(SPECIAL).replace("±", "$\\pm$").replace("∞", "$\\infty$") for cell in cells]
        first = f"\\textit{{{cells[0]}}}" if place in table.italic else cells[0]
        lines.append(" & ".join([first, *cells[1:]]) + " \\\\")
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", ""])


def plain_html(table: Plain) -> str:
    """The table as a fragment for `page.build_page`, without its legend."""
    out = ["<div class=scroll><table class=scores><thead><tr>"]
    out += [f"<th scope=col>{escape(head)}" for head in table.heads]
    out.append("<tbody>")
    for place, (cells, row) in enumerate(zip(texts(table), table.rows)):
        out.append(f"<tr{' class=baseline' if place in table.italic else ''}><th scope=row>{escape(cells[0])}")
        for cell, value in zip(cells[1:], row[1:]):
            mean, _, margin = cell.partition(" ± ") if isinstance(value, Estimate) else (cell, "", "")
            out.append(f"<td>{escape(mean)}" + (f"<small>±{margin}</small>" if margin else ""))
    return "\n".join([*out, "</table></div>"])
