"""Tables as CSV (everything), Markdown, LaTeX and HTML (what is shown).

Bold is the best network of a column; n.s. (not significant) marks what the figures at hand cannot tell from it.
"""

import csv
import io
import re
from html import escape
from itertools import pairwise
from pathlib import Path

import numpy as np

from relight.evaluation.metrics import COLUMNS
from relight.evaluation.tables import ALPHA, Cell, Row, Table, sign
from relight.files import whole

QUANTITY = {
    "shading": "Shading",
    "shading_true_light": "Shading, true light",
    "transport": "Transport",
    "transport_with_ao": "Transport × AO",
    "normal": "Normal",
    "ao": "AO",
    "light": "Light",
    "sphere": "Sphere",
    "albedo": "Albedo",
    "reconstruction": "Reconstruction",
}
READING = {"rmse": "RMSE", "rmse_element": "RMSE per element", "ssim": "SSIM", "ssim_range2": "SSIM, range 2"}


def write_table(table: Table, stem: Path) -> list[Path]:
    """Writes stem.csv, stem.md and stem.tex, each whole or not at all; returns their paths."""
    paths = []
    for suffix, text in (("csv", to_csv), ("md", to_markdown), ("tex", to_latex)):
        paths.append(stem.with_suffix(f".{suffix}"))
        with whole(paths[-1]) as tmp:
            tmp.write_text(text(table), encoding="utf-8")
    return paths


def split_column(column: str) -> tuple[str, str]:
    """shading_true_light_rmse -> (shading_true_light, rmse)."""
    reading = max((r for r in READING if column.endswith(f"_{r}")), key=len)
    return column.removesuffix(f"_{reading}"), reading


def blocks(table: Table, columns: tuple[str, ...]) -> dict[str, list[str]]:
    """The columns by reading, without those that no row has."""
    found: dict[str, list[str]] = {}
    for column in columns:
        if any(column in row.cells for row in table.rows):
            found.setdefault(split_column(column)[1], []).append(column)
    return found


def legend(table: Table) -> str:
    """What the numbers are, in words."""
    if not table.rows:
        return "The data set has no figure, or no light, of this kind: there is nothing to compare."
    trainings = {row.trainings for row in table.rows if not row.baseline}
    several = f"{min(trainings)} to {max(trainings)}" if len(trainings) > 1 else f"{max(trainings)}"
    once = "1 training" if several == "1" else f"{several} trainings"
    text = (
        f"Means over {count(table.figures, 'test figure')} under {count(table.lights, 'test light')}, {once} a row; "
        "± is half the 95 % interval, from a bootstrap over figures"
    )
    text += " and the spread of the trainings" if max(trainings) > 1 else ""
    return text + (
        ". Bold: the best network of the column; n.s.: a paired test cannot tell it from the best "
        f"(p ≥ {ALPHA}, Holm's correction over the table). RMSE is inside the mask, over pixels of the vector norm "
        "(light: over coefficients); SSIM is inside the mask's bounding box. Rows in italics look at no picture."
    )


def count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def to_csv(table: Table) -> str:
    """All columns, shown or not: mean, interval, and Holm-corrected p-value of the difference from the best network."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    columns = [column for part in blocks(table, COLUMNS).values() for column in part]
    parts = ("", "_low", "_high", "_p")
    writer.writerow(["row", "kind", "trainings", *(column + part for column in columns for part in parts)])
    for row in table.rows:
        values = [_csv(row.cells.get(column)) for column in columns]
        kind = "baseline" if row.baseline else "network"
        writer.writerow([row.name, kind, row.trainings, *(value for cell in values for value in cell)])
    for label, printed in table.printed.items():
        values = [(f"{printed[c]:.3f}" if c in printed else "", "", "", "") for c in columns]
        writer.writerow([label, "paper", 1, *(value for cell in values for value in cell)])
    return out.getvalue()


def _csv(cell: Cell | None) -> tuple[str, str, str, str]:
    if cell is None:
        return "", "", "", ""
    one = cell.estimate
    p = "" if cell.p is None else f"{cell.p:.4g}"
    return f"{one.mean:.5f}", f"{one.low:.5f}", f"{one.high:.5f}", p


def number(value: float) -> str:
    """Three decimals, without the leading zero, as the margins are written."""
    return "∞" if np.isinf(value) else re.sub(r"^(-?)0\.", r"\1.", f"{value:.3f}")


def to_markdown(table: Table) -> str:
    """One table per reading, the shown columns; then the paper's own numbers, then all other columns."""
    out = [f"## {table.title}", "", legend(table), ""]
    for part in (table.columns, tuple(column for column in COLUMNS if column not in table.columns)):
        if part is not table.columns:
            out += ["### Other readings of the same scores", ""]
        for reading, columns in blocks(table, part).items():
            arrow = "↓" if sign(columns[0]) > 0 else "↑"
            out += [
                f"| {READING[reading]} {arrow} | " + " | ".join(QUANTITY[split_column(c)[0]] for c in columns) + " |"
            ]
            out += ["|---|" + "---|" * len(columns)]
            for row in table.rows:
                if not any(column in row.cells for column in columns):
                    continue
                label = f"*{row.label}*" if row.baseline else row.label
                out += [f"| {label} | " + " | ".join(_markdown(row.cells.get(c)) for c in columns) + " |"]
            for label, printed in table.printed.items():
                if any(column in printed for column in columns):
                    values = (number(printed[c]) if c in printed else "" for c in columns)
                    out += [f"| {label} | " + " | ".join(values) + " |"]
            out += [""]
    return "\n".join(out)


def _markdown(cell: Cell | None) -> str:
    if cell is None:
        return ""
    mean = number(cell.estimate.mean)
    mark = " n.s." if cell.undecided else ""
    return f"{f'**{mean}**' if cell.best else mean} ± {number(cell.estimate.margin)}{mark}"


def to_latex(table: Table) -> str:
    """A tabular of the shown columns (package booktabs)."""
    parts = blocks(table, table.columns)
    columns = [column for part in parts.values() for column in part]
    rules = " ".join(f"\\cmidrule(lr){{{a}-{b}}}" for a, b in _spans(parts))
    arrows = {reading: "\\downarrow" if sign(part[0]) > 0 else "\\uparrow" for reading, part in parts.items()}
    heads = [f"\\multicolumn{{{len(part)}}}{{c}}{{{READING[r]} ${arrows[r]}$}}" for r, part in parts.items()]
    lines = [
        f"% {table.title}. Needs \\usepackage{{booktabs}}.",
        f"% {legend(table).replace('%', chr(92) + '%')}",
        "\\begin{tabular}{l" + "".join("c" * len(part) for part in parts.values()) + "}",
        "\\toprule",
        " & " + " & ".join(heads) + " \\\\ " + rules,
        " & " + " & ".join(QUANTITY[split_column(c)[0]].replace("×", "$\\times$") for c in columns) + " \\\\",
        "\\midrule",
    ]
    baseline = False
    for row in table.rows:
        if row.baseline and not baseline:
            lines.append("\\midrule")
            baseline = True
        if any(column in row.cells for column in columns):
            label = f"\\textit{{{row.label}}}" if row.baseline else row.label
            lines.append(" & ".join([label, *(_latex(row.cells.get(c)) for c in columns)]) + " \\\\")
    if table.printed:
        lines.append("\\midrule")
    for label, printed in table.printed.items():
        values = [number(printed[c]) if c in printed else "--" for c in columns]
        lines.append(" & ".join([label, *values]) + " \\\\")
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", ""])


def _spans(parts: dict[str, list[str]]) -> list[tuple[int, int]]:
    ends = np.cumsum([1, *(len(part) for part in parts.values())])
    return [(int(a) + 1, int(b)) for a, b in pairwise(ends)]


def _latex(cell: Cell | None) -> str:
    if cell is None:
        return "--"
    mean = number(cell.estimate.mean)
    margin = number(cell.estimate.margin).replace("∞", "$\\infty$")
    text = f"{f'{chr(92)}textbf{{{mean}}}' if cell.best else mean}{{\\tiny$\\pm${margin}}}"
    return f"{text}$^{{\\mathrm{{n.s.}}}}$" if cell.undecided else text


def to_html(table: Table, columns: tuple[str, ...] | None = None) -> str:
    """The tables of `columns` (the shown ones if None), one per reading, as a fragment for `page.build_page`."""
    out = []
    for reading, part in blocks(table, columns or table.columns).items():
        arrow = "lower is better" if sign(part[0]) > 0 else "higher is better"
        heads = "".join(f"<th scope=col>{QUANTITY[split_column(c)[0]]}" for c in part)
        out.append("<div class=scroll><table class=scores><thead><tr>")
        out.append(f"<th scope=col>{READING[reading]} <small>{arrow}</small>{heads}<tbody>")
        rows = [row for row in table.rows if any(c in row.cells for c in part)]
        for row in rows:
            out.append(f"<tr{' class=baseline' if row.baseline else ''}><th scope=row>{escape(row.label)}")
            out.extend(_html(row, c) for c in part)
        for label, printed in table.printed.items():
            if any(c in printed for c in part):
                out.append(f"<tr class=paper><th scope=row>{escape(label)}")
                out.extend(f"<td>{number(printed[c]) if c in printed else ''}" for c in part)
        out.append("</table></div>")
    return "\n".join(out)


def _html(row: Row, column: str) -> str:
    cell = row.cells.get(column)
    if cell is None:
        return "<td>"
    one, mean = cell.estimate, number(cell.estimate.mean)
    hint = f"{mean}, 95 % interval {number(one.low)} to {number(one.high)}"
    if cell.against is not None:
        hint += f"; {number(abs(cell.against.mean))} from the best, p = {cell.p:.3g}"
    text = f"<b>{mean}</b>" if cell.best else mean
    mark = "<i>n.s.</i>" if cell.undecided else ""
    return f'<td title="{hint}">{text}<small>±{number(one.margin)}</small>{mark}'
