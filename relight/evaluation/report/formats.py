"""Formats tables: pandas frames of cells, written as CSV and Markdown.

Bold is the best network of a column; n.s. marks values that do not differ significantly from it.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from relight.core.files import write_text
from relight.evaluation.scoring.comparisons import Comparison, Verdict
from relight.evaluation.scoring.statistics import Estimate
from relight.evaluation.scoring.tables import Table
from relight.settings.scores import COLUMNS, QUANTITIES, READINGS, column_label, sign

SIGNS = {
    Verdict.BETTER: "✓", Verdict.WORSE: "✗", Verdict.DIFFERENT: "≠", Verdict.EQUIVALENT: "≈", Verdict.OPEN: "?"
}  # fmt: skip
ARROWS = {1: " ↓", -1: " ↑", 0: ""}  # toward what is better


@dataclass
class TextTable:
    """A table for readers.

    Attributes:
        frame: indexed by the rows' labels; cells are Estimate, Verdict, str, int, float or None; columns are names, or
            pairs (block, name).
        kinds: kind of each row: "network", "baseline", "paper", or "" as by default.
        digits: decimals by column, 3 by default.
    """

    frame: pd.DataFrame
    kinds: list[str] = field(default_factory=list)
    digits: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.frame = self.frame.astype(object).where(self.frame.notna(), None)
        self.kinds = self.kinds or [""] * len(self.frame)

    @classmethod
    def of(cls, columns: list[str], rows: list[list[Any]], **options: Any) -> "TextTable":
        """Returns a grid of rows of cells, the first of which is the label, under as many heads; options are fields."""
        index = pd.Index([row[0] for row in rows], name=columns[0], dtype=object)
        return cls(pd.DataFrame([row[1:] for row in rows], index, columns[1:], dtype=object), **options)

    def blocks(self) -> list["TextTable"]:
        """Returns a grid per block of columns, without rows that are empty there; the grid itself without blocks."""
        if self.frame.columns.nlevels == 1:
            return [self]
        grids = []
        for block in dict.fromkeys(self.frame.columns.get_level_values(0)):
            part = self.frame[block]
            kept = part.notna().any(axis=1).to_numpy()
            part = part[kept].rename_axis(index=block)  # the heading of the first column
            grids.append(TextTable(part, [kind for kind, is_kept in zip(self.kinds, kept) if is_kept], self.digits))
        return grids

    def statistics(self) -> pd.DataFrame:
        """Returns the frame, of one block, as numbers: an estimate as mean, low and high, to six significant digits."""
        statistics = {}
        for column in self.frame:
            values = list(self.frame[column])
            if any(isinstance(value, Estimate) for value in values):
                for end, name in (("", "mean"), (", low", "low"), (", high", "high")):
                    statistics[f"{column}{end}"] = [getattr(value, name, np.nan) for value in values]
            else:
                statistics[column] = values

        def rounded(value: object) -> object:
            if isinstance(value, Verdict):
                return value.value
            return float(f"{value:.6g}") if isinstance(value, float) else value

        return pd.DataFrame(statistics, self.frame.index).map(rounded)


def to_markdown(grid: TextTable) -> str:
    """Returns a grid in Markdown, a table per block of columns: baselines in italics, the paper's rows as printed."""
    tables, forms = [], {"paper": "{}, as printed", "baseline": "*{}*"}
    for block in grid.blocks():
        heads = [_escaped(head) for head in block.frame.columns]
        digits = [block.digits.get(head, 3) for head in block.frame.columns]
        labels = [
            forms.get(kind, "{}").format(_escaped(str(text))) for text, kind in zip(block.frame.index, block.kinds)
        ]
        cells = [list(map(_cell, row, digits)) for row in block.frame.itertuples(index=False, name=None)]
        corner = _escaped(block.frame.index.name or "")
        tables.append(pd.DataFrame(cells, pd.Index(labels, name=corner), heads).to_markdown(disable_numparse=True))
    return "\n\n".join(tables)


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _cell(value: object, digits: int) -> str:
    """Returns a cell as text: estimates with their margin, numbers with `digits` decimals, empty for None."""
    if value is None:
        return ""
    if isinstance(value, Estimate):
        mean, margin = (number(part, digits) for part in (value.mean, value.margin))
        return f"{f'**{mean}**' if value.best else mean} ± {margin}{' n.s.' * value.not_significant}"
    if isinstance(value, Verdict):
        return f"{SIGNS[value]} {value.value}"
    return number(value, digits) if isinstance(value, float) else _escaped(str(value))


def write_tables(
    stem: Path,
    title: str,
    note: str,
    shown: TextTable,
    statistics: pd.DataFrame | None = None,
    others: TextTable | None = None,
) -> None:
    """Writes a table as stem.csv and stem.md, each atomically.

    Args:
        stem: path without suffix.
        title, note: of the table; what explains the numbers. Both are in Markdown.
        shown: the table.
        statistics: content of the CSV; by default the statistics of `shown`.
        others: a further grid for the Markdown file.
    """
    statistics = shown.statistics() if statistics is None else statistics
    parts = [f"## {title}", note, to_markdown(shown)]
    if others is not None:
        parts += ["### Other readings of the same scores", to_markdown(others)]
    csv = statistics.to_csv(index=statistics.index.name is not None, lineterminator="\n")
    write_text(stem.with_suffix(".csv"), csv)
    write_text(stem.with_suffix(".md"), "\n\n".join(parts) + "\n")


def score_grid(table: Table, columns: Iterable[str]) -> TextTable:
    """Returns columns of a table, a block per reading; rows of the paper's printed values follow."""
    present = table.present(columns)
    rows: list[tuple[str, str, Mapping[str, Estimate | float]]] = [
        (table.label(row), table.kind(row), cells) for row, cells in table.rows.items()
    ]
    rows += [(table.label(row), "paper", values) for row, values in table.printed.items()]
    rows = [row for row in rows if any(column in row[2] for column in present)]
    readings = [f"{READINGS[COLUMNS[column][1]].label}{ARROWS[sign(column)]}" for column in present]
    quantities = [QUANTITIES[COLUMNS[column][0]].label for column in present]
    cells = [[values.get(column) for column in present] for *_, values in rows]
    index = pd.Index([name for name, *_ in rows], dtype=object)
    columns = pd.MultiIndex.from_arrays([readings, quantities])
    return TextTable(pd.DataFrame(cells, index, columns, dtype=object), [kind for _, kind, _ in rows])


def other_columns(table: Table) -> tuple[str, ...]:
    """Returns the columns of the scores that a table does not show."""
    return tuple(column for column in table.scored if column not in table.columns)


def comparison_grid(comparisons: dict[str, dict[str, Comparison]]) -> TextTable:
    """Returns comparisons with relative gain, both means, p-value, verdict, and a bound on open differences."""
    heads = ["compared", "in", "first better by", "interval", "first", "second", "p", "the first is", "within"]
    rows = [
        [pair, column_label(c.column), *effect(c), c.first, c.second, p_value(c.p), c.verdict, bound(c)]
        for pair, by_column in comparisons.items()
        for c in by_column.values()
    ]
    return TextTable.of(heads, rows)


def effect(comparison: Comparison) -> tuple[str, str]:
    """Returns the gain of the first row relative to the second, "+3.1 %", and its interval, "+1.0 to +5.2 %"."""
    return percent(comparison.gain), " to ".join(map(percent, comparison.interval)).replace(" % to", " to")


def bound(comparison: Comparison) -> str | None:
    """Returns the relative bound on a difference whose verdict is equivalent or open; None for the others."""
    return None if comparison.verdict.is_significant else f"±{percent(comparison.bound).lstrip('+')}"


def number(value: float, digits: int = 3) -> str:
    """Formats a number with fixed decimals and without a leading zero: .123, −.5, ∞; NaN as a dash."""
    if np.isnan(value):
        return "–"
    if not np.isfinite(value):
        return "∞" if value > 0 else "−∞"
    text = re.sub(r"^(-?)0\.", r"\1.", f"{value:.{digits}f}")
    return text.replace("-", "−") if float(f"{value:.{digits}f}") else text.removeprefix("-")


def percent(value: float) -> str:
    """Formats a fraction as a percentage with a sign and one decimal; NaN as a dash."""
    if not np.isfinite(value):
        return number(value)
    text = f"{100 * value:+.1f} %".replace("-", "−")
    return text if text[1:] != "0.0 %" else text[1:]


def p_value(p: float) -> str:
    """Formats a p-value with two significant digits, such as .034."""
    return "< .0001" if p < 1e-4 else f"{p:.2g}".removeprefix("0")


def count(many: int, noun: str) -> str:
    """Formats a count: 1 figure, 2 figures."""
    return f"{many} {noun}" if many == 1 else f"{many} {noun}s"
