"""Tables to be read: pandas frames of cells, written as CSV, Markdown, LaTeX and HTML.

Bold is the best network of a column; n.s. (not significant) marks what the figures at hand cannot tell from it.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from markupsafe import escape

from relight.evaluation.comparisons import Comparison, Verdict
from relight.evaluation.metrics import COLUMNS
from relight.evaluation.statistics import Estimate
from relight.evaluation.tables import LABELS, QUANTITY, READING, Cell, Table, sign, split_column
from relight.files import atomic_write

SIGNS = {Verdict.BETTER: "✓", Verdict.WORSE: "✗", Verdict.EQUIVALENT: "≈", Verdict.OPEN: "?"}
LATEX = {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "×": r"$\times$", "²": "$^2$", "–": "--", "∞": r"$\infty$"}
LATEX |= {"↓": r"$\downarrow$", "↑": r"$\uparrow$", "≈": r"$\approx$", "✓": "", "✗": "", "−": "$-$"}


@dataclass
class Grid:
    """A table to be read.

    frame: a row per label, its cells Cell, Estimate, Verdict, str, int, float or None; its columns are flat, or pairs
    (block, column). kinds: what each row is: "network", "baseline" or "paper"; "" where that has no meaning.
    digits: decimals of the numbers of a column, 3 if not given.
    """

    frame: pd.DataFrame
    kinds: list[str] = field(default_factory=list)
    digits: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, columns: list[str], rows: list[list], kinds: list[str] | None = None, **digits: int) -> "Grid":
        """From rows of cells, of which the first is the label; `columns` names it and the others."""
        index = pd.Index([row[0] for row in rows], name=columns[0], dtype=object)
        frame = pd.DataFrame([row[1:] for row in rows], index, columns[1:], dtype=object)
        return cls(frame.where(frame.notna(), None), kinds or [""] * len(rows), digits)

    def blocks(self) -> list["Grid"]:
        """One grid per block of columns, without the rows that have nothing in it."""
        found = []
        for block in dict.fromkeys(self.frame.columns.get_level_values(0)):
            part = self.frame[block]
            kept = part.notna().any(axis=1).to_numpy()
            part = part[kept].rename_axis(index=block)
            found.append(Grid(part, [kind for kind, one in zip(self.kinds, kept) if one], self.digits))
        return found

    def texts(self, style: "Style") -> pd.DataFrame:
        """The frame with every cell, label and head as text."""
        heads = [h if isinstance(h, tuple) else (h,) for h in self.frame.columns]
        cells = [
            [style.cell(value, self.digits.get(head[-1], 3)) for value, head in zip(row, heads)]
            for row in self.frame.itertuples(index=False, name=None)
        ]
        labels = [
            style.label(label if isinstance(label, str) else str(label), kind)
            for label, kind in zip(self.frame.index, self.kinds)
        ]
        escaped = [tuple(map(style.escape, head)) for head in heads]
        columns = pd.MultiIndex.from_tuples(escaped) if heads and len(heads[0]) > 1 else [head[0] for head in escaped]
        return pd.DataFrame(cells, pd.Index(labels, name=style.escape(self.frame.index.name or "")), columns)

    def statistics(self) -> pd.DataFrame:
        """The frame for programs: each estimate as its mean, low and high, to six significant digits."""
        made = {}
        for column in self.frame:
            values = [getattr(value, "estimate", value) for value in self.frame[column]]
            column = ", ".join(column) if isinstance(column, tuple) else column
            if any(isinstance(value, Estimate) for value in values):
                for end, name in (("", "mean"), (", low", "low"), (", high", "high")):
                    made[f"{column}{end}"] = [getattr(value, name, np.nan) for value in values]
            else:
                made[column] = values
        return pd.DataFrame(made, self.frame.index).map(lambda v: float(f"{v:.6g}") if isinstance(v, float) else v)


@dataclass
class Style:
    """How a format writes a label, a number, its margin and its marks; {} stands for the text."""

    bold: str
    italic: str
    margin: str
    undecided: str
    escape: Callable[[str], str]

    def label(self, text: str, kind: str) -> str:
        text = self.escape(text if kind != "paper" else f"{text}, as printed")
        return self.italic.format(text) if kind == "baseline" else text

    def cell(self, value: object, digits: int) -> str:
        if value is None:
            return ""
        if isinstance(value, Cell):
            return self.estimate(value.estimate, digits, value.best) + self.undecided * value.undecided
        if isinstance(value, Estimate):
            return self.estimate(value, digits)
        if isinstance(value, Verdict):
            return self.escape(f"{SIGNS[value]} {value.value}").strip()
        if isinstance(value, float):
            return self.escape(number(value, digits))
        return self.escape(value if isinstance(value, str) else str(value))

    def estimate(self, one: Estimate, digits: int, best: bool = False) -> str:
        mean, margin = (self.escape(number(value, digits)) for value in (one.mean, one.margin))
        return (self.bold if best else "{}").format(mean) + self.margin.format(margin)


MARKDOWN = Style("**{}**", "*{}*", " ± {}", " n.s.", lambda text: text.replace("|", "\\|"))
TEX = Style(
    r"\textbf{{{}}}",
    r"\textit{{{}}}",
    r"{{\tiny$\pm${}}}",
    r"$^{\mathrm{n.s.}}$",
    lambda text: text.translate(str.maketrans(LATEX)),
)
HTML = Style("<b>{}</b>", "{}", "<small>±{}</small>", "<i>n.s.</i>", lambda text: str(escape(text)))


def to_markdown(grid: Grid) -> str:
    return grid.texts(MARKDOWN).to_markdown(disable_numparse=True)


def to_latex(grid: Grid) -> str:
    """A tabular (package booktabs), with a rule before baselines and before printed values."""
    texts = grid.texts(TEX).rename_axis(index=None)
    lines = texts.to_latex(escape=False, multicolumn_format="c", column_format="l" + "c" * texts.shape[1]).splitlines()
    body = lines.index(r"\midrule") + 1
    for place in range(len(grid.kinds) - 1, 0, -1):
        if grid.kinds[place] != grid.kinds[place - 1]:
            lines.insert(body + place, r"\midrule")
    return "\n".join([*lines, ""])


def write_tables(
    stem: Path, title: str, note: str, statistics: pd.DataFrame, shown: Grid, more: Sequence[Grid] = ()
) -> None:
    """Writes stem.csv (all numbers), stem.md and stem.tex (what is shown), each whole or not at all.

    Args:
        stem: path without suffix.
        title: of the table, plain text.
        note: what the numbers are, in Markdown.
        statistics: the numbers, each in a column.
        shown: the table itself; LaTeX has it whole, Markdown by blocks where it has any.
        more: further grids for the Markdown file.
    """
    parts = [f"## {title}", note, *map(to_markdown, blocks(shown))]
    parts += ["### Other readings of the same scores"] * bool(more) + [to_markdown(grid) for grid in more]
    comments = [f"% {line}" for line in [f"{title}. Needs \\usepackage{{booktabs}}.", *note.splitlines()]]
    texts = {
        ".csv": statistics.to_csv(index=statistics.index.name is not None, lineterminator="\n"),
        ".md": "\n\n".join(parts) + "\n",
        ".tex": "\n".join([*comments, to_latex(shown)]),
    }
    for suffix, text in texts.items():
        with atomic_write(stem.with_suffix(suffix)) as tmp:
            tmp.write_text(text, encoding="utf-8")


def blocks(grid: Grid) -> list[Grid]:
    """The grid by blocks of columns, or alone where it has none."""
    return grid.blocks() if grid.frame.columns.nlevels > 1 else [grid]


def score_grid(table: Table, columns: tuple[str, ...]) -> Grid:
    """The cells of a table in some of its columns, a block per reading."""
    found = [column for part in table.blocks(columns).values() for column in part]
    heads = []
    for quantity, reading in map(split_column, found):
        heads.append((f"{READING[reading]} {'↓' if sign(f'_{reading}') > 0 else '↑'}", QUANTITY[quantity]))
    rows = [row for row in table.rows if any(column in row.cells for column in found)]
    printed = {row: v for row, v in table.printed.items() if any(column in v for column in found)}
    cells = [[row.cells.get(c) for c in found] for row in rows] + [[v.get(c) for c in found] for v in printed.values()]
    labels = [row.label for row in rows] + [LABELS[row] for row in printed]
    kinds = ["baseline" if row.baseline else "network" for row in rows] + ["paper"] * len(printed)
    frame = pd.DataFrame(
        cells, labels, pd.MultiIndex.from_arrays([[head[i] for head in heads] for i in (0, 1)]), dtype=object
    )
    return Grid(frame.where(frame.notna(), None), kinds)


def other_columns(table: Table) -> tuple[str, ...]:
    """The columns that a table holds and does not show."""
    return tuple(column for column in COLUMNS if column not in table.columns)


def comparison_grid(found: dict[str, dict[str, Comparison]]) -> Grid:
    """Comparisons by what is compared and column: the relative gain and its interval, both means, p and verdict, and
    the bound under which a difference that is not sure is shown to lie."""
    heads = ["compared", "in", "first better by", "95 % interval", "first", "second", "p", "the first is", "within"]
    rows = [
        [what, column_name(c.column), *effect(c), c.first, c.second, p_value(c.p), c.verdict, bound(c)]
        for what, ones in found.items()
        for c in ones.values()
    ]
    return Grid.of(heads, rows)


def effect(one: Comparison) -> tuple[str, str]:
    """How much better the first is, relative to the second, and the 95 % interval of that."""
    return percent(one.relative), " to ".join(map(percent, one.relative_gains)).replace(" % to", " to")


def bound(one: Comparison) -> str | None:
    """The relative bound of a difference that is open, or none for practical purposes."""
    return None if one.verdict in (Verdict.BETTER, Verdict.WORSE) else f"±{100 * one.bound:.1f} %"


def column_name(column: str) -> str:
    """shading_rmse -> shading RMSE."""
    quantity, reading = split_column(column)
    words = QUANTITY[quantity]
    return f"{words if words.isupper() else words[0].lower() + words[1:]} {READING[reading]}"


def number(value: float, digits: int = 3) -> str:
    """Fixed decimals without the leading zero, as the margins are written: .123, −.5, ∞."""
    if not np.isfinite(value):
        return "∞" if value > 0 else "−∞"
    text = re.sub(r"^(-?)0\.", r"\1.", f"{value:.{digits}f}")
    return text.replace("-", "−") if float(f"{value:.{digits}f}") else text.removeprefix("-")


def percent(value: float) -> str:
    """With its sign, to a tenth."""
    if not np.isfinite(value):
        return "∞" if value > 0 else "−∞"
    text = f"{100 * value:+.1f} %".replace("-", "−")
    return text if text[1:] != "0.0 %" else text[1:]


def p_value(p: float) -> str:
    return "< .0001" if p < 1e-4 else f"{p:.2g}".removeprefix("0")


def count(many: int, noun: str) -> str:
    """1 figure, 2 figures."""
    return f"{many} {noun}" if many == 1 else f"{many} {noun}s"
