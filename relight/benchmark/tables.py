"""Compares methods on the benchmark in tables."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from relight.benchmark.measures import INVARIANCES, LEAKS
from relight.benchmark.score import MAP_COLUMNS, PICTURE_HEADS
from relight.core.errors import UserError
from relight.evaluation.report.formats import TextTable, count
from relight.evaluation.scoring.statistics import MIN_SUBJECTS, Estimate, estimate

MAP_HEADS = {name: name.replace("_factor", "*").replace("_ssim", " SSIM") for name in MAP_COLUMNS}
ERROR_HEADS = {name: head for name, head in (PICTURE_HEADS | MAP_HEADS).items() if not name.endswith(("ssim", "psnr"))}
DIGITS = {head: 2 for head in PICTURE_HEADS.values() if head.endswith("PSNR")}
STAR = "A star: after the best factor for each picture."


@dataclass
class ComparisonTable:
    """A table with its title, and a note that explains its numbers."""

    title: str
    note: str
    grid: TextTable


class MethodComparison:
    """Methods that were scored on one set.

    Args:
        rows: the scores of each method (`score.read_scores`); differences are taken from the first.

    Raises:
        UserError: if the methods were scored on different sets, or two have the same name.
    """

    def __init__(self, rows: list[pd.DataFrame]):
        self.scores = {row.attrs["method"]: row for row in rows}
        if len(self.scores) < len(rows):
            raise UserError("two folders of answers have the same name, by which tables tell methods apart: rename one")
        self.reference, first = next(iter(self.scores.items()))
        for name, row in self.scores.items():
            if not row.index.equals(first.index):
                raise UserError(
                    f"{name} and {self.reference} were scored on different sets: score both on the same one"
                )
        self.sample = f"of set {rows[0].index[0][0]}, ± half the 95 % interval (bootstrap over figures)."
        if first.index.get_level_values("figure").nunique() < MIN_SUBJECTS:
            self.sample += f" Fewer than {MIN_SUBJECTS} figures decide nothing: intervals may leave the possible range."

    def tables(self) -> dict[str, ComparisonTable]:
        """Returns tables of relit pictures, of maps and light, of differences, and of invariances, by file stem."""
        unit_of_maps = "RMSE of vectors; light: relative error of irradiance."
        made = {
            "benchmark_pictures": self.methods("Relit pictures", PICTURE_HEADS, "Errors of sRGB codes in [0,1]."),
            "benchmark_maps": self.methods("Maps and light", MAP_HEADS, unit_of_maps),
            "benchmark_differences": self.differences(),
            "benchmark_invariance": self.invariances(),
        }
        return {name: table for name, table in made.items() if table.grid.frame.shape[1]}

    def methods(self, title: str, heads: dict[str, str], words: str) -> ComparisonTable:
        """Returns the means of columns of the scores, by `heads`, with a row per method; `words` say their unit."""
        grid = _columns_with_cells(heads, {name: self.cells(scores, heads) for name, scores in self.scores.items()})
        return ComparisonTable(title, f"{words} All are {self.counted(self.scores, heads)} {self.sample} {STAR}", grid)

    def differences(self) -> ComparisonTable:
        """Returns the differences of the other methods from the reference, paired by picture."""
        reference = self.scores[self.reference]
        cells = {name: self.cells(row - reference, ERROR_HEADS) for name, row in [*self.scores.items()][1:]}
        grid = _columns_with_cells(ERROR_HEADS, cells)
        heads = [name for name, head in ERROR_HEADS.items() if head in grid.frame]
        words = (
            f"Error of each method minus that of {self.reference}, picture by picture; positive where {self.reference} "
            f"is better. All are {self.counted([self.reference], heads)} {self.sample} {STAR}"
        )
        return ComparisonTable(f"Differences from {self.reference}", words, grid)

    def invariances(self) -> ComparisonTable:
        """Returns the invariances and leaks, with a column per method, since there are more measures than methods."""
        measures = INVARIANCES | LEAKS
        cells = {name: self.cells(scores, measures) for name, scores in self.scores.items()}
        cells = {name: by_measure for name, by_measure in cells.items() if any(by_measure.values())}
        words = (
            "Ideally 0, but 1 for albedo at exposure x .5 and for a tint, and .5 for shading at exposure x .5; "
            f"{self.counted(cells, INVARIANCES)}. The last four rows measure leaks of the albedo into the shading; "
            f"{self.counted(cells, LEAKS)} {self.sample}"
        )
        lines = [[what, *(by_measure[name] for by_measure in cells.values())] for name, what in measures.items()]
        return ComparisonTable("Invariances and leaks", words, TextTable.of(["measure", *cells], lines))

    def cells(self, scores: pd.DataFrame, columns: Iterable[str]) -> dict[str, Estimate | None]:
        """Returns the estimates of columns of a method's scores over figures; None for those without a score."""
        means = scores.groupby("figure", sort=False).mean()
        known = {column: means[column].dropna().to_numpy() for column in columns}
        return {column: estimate(values[None, :, None]) if len(values) else None for column, values in known.items()}

    def counted(self, methods: Iterable[str], columns: Iterable[str]) -> str:
        """Returns the numbers of pictures and figures for which any of the methods has a score, in words."""
        answered = [self.scores[name][list(columns)].notna().any(axis=1) for name in methods]
        index = self.scores[self.reference].index
        scored = index[np.any(answered, 0)] if answered else index[:0]
        figures = scored.get_level_values("figure").nunique()
        return f"means over {count(len(scored), 'picture')} of {count(figures, 'figure')}"


def _columns_with_cells(heads: dict[str, str], rows: dict[str, dict[str, Estimate | None]]) -> TextTable:
    """Returns a grid, a row per method and a head per column of the scores, without empty rows and columns."""
    shown = {name: head for name, head in heads.items() if any(cells[name] for cells in rows.values())}
    lines = [[method, *(cells[name] for name in shown)] for method, cells in rows.items()]
    return TextTable.of(["method", *shown.values()], [line for line in lines if any(line[1:])], digits=DIGITS)
