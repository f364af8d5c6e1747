"""What a difference between two rows amounts to, and which of the paper's orderings hold here."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from relight.evaluation.paper import ARGUMENTS, printed
from relight.evaluation.statistics import Difference, Estimate, compare, holm
from relight.evaluation.tables import ALPHA, Row, Table, sign

MARGIN = 0.035  # relative: smaller differences count as none; most of those that the paper prints are smaller
COLUMNS = tuple(f"{q}_{reading}" for q in ("shading", "transport", "light", "albedo") for reading in ("rmse", "ssim"))


class Verdict(Enum):
    """The first of two rows against the second, by tests at ALPHA over all comparisons that are read together."""

    BETTER = "better"
    WORSE = "worse"
    EQUIVALENT = "equivalent"  # their difference is shown to be under MARGIN
    OPEN = "open"  # these figures and lights cannot tell


@dataclass
class Comparison:
    """Two rows in one column. `difference` is first minus second; both p-values are corrected (Holm)."""

    column: str
    first: float
    second: float
    difference: Difference
    p: float = 1.0
    p_equivalent: float = 1.0

    @property
    def verdict(self) -> Verdict:
        if self.p < ALPHA and not self.difference.low <= 0 <= self.difference.high:
            return Verdict.BETTER if self.gain > 0 else Verdict.WORSE
        return Verdict.EQUIVALENT if self.p_equivalent < ALPHA else Verdict.OPEN

    @property
    def gain(self) -> float:
        """How much better the first row is, in the unit of the column."""
        return -sign(self.column) * self.difference.mean

    @property
    def gains(self) -> tuple[float, float]:
        """The 95 % interval of `gain`."""
        low, high = sorted(-sign(self.column) * end for end in (self.difference.low, self.difference.high))
        return low, high

    @property
    def relative(self) -> float:
        """`gain` over the mean of the second row."""
        return self.gain / abs(self.second) if self.second else 0.0

    @property
    def relative_gains(self) -> tuple[float, float]:
        """The 95 % interval of `relative`, the second row's mean being taken as known."""
        low, high = self.gains
        return (low / abs(self.second), high / abs(self.second)) if self.second else (0.0, 0.0)

    @property
    def bound(self) -> float:
        """The least margin, relative to the mean of both rows, at which they are equivalent at ALPHA, read alone."""
        level = (abs(self.first) + abs(self.second)) / 2
        return self.difference.bound(ALPHA) / level if level else np.inf


def compared(column: str, first: Estimate, second: Estimate) -> Comparison:
    """Two estimates compared alone."""
    difference = compare(first, second)
    equivalent = difference.p_equivalent(MARGIN * (abs(first.mean) + abs(second.mean)) / 2)
    return Comparison(column, first.mean, second.mean, difference, difference.p, equivalent)


def correct(found: list[Comparison]) -> list[Comparison]:
    """Corrects the p-values of comparisons that are read together, in place (Holm)."""
    for name in ("p", "p_equivalent"):
        for one, p in zip(found, holm([getattr(one, name) for one in found])):
            setattr(one, name, float(p))
    return found


def compare_rows(first: Row, second: Row, columns: tuple[str, ...]) -> dict[str, Comparison]:
    """The first row against the second in those of `columns` that both have, p-values corrected together."""
    both = [column for column in columns if column in first.cells and column in second.cells]
    found = [compared(c, first.cells[c].estimate, second.cells[c].estimate) for c in both]
    return {one.column: one for one in correct(found)}


@dataclass
class Ordering:
    """One ordering that the paper prints: `better` before `worse` in a column, and the same comparison here.

    argued: whether that is the order of the paper's argument; its tables print some the other way round.
    gap: the relative difference of the two printed values.
    """

    better: str
    worse: str
    argued: bool
    gap: float
    here: Comparison

    @property
    def small(self) -> bool:
        """Whether the printed difference is itself one that counts as none."""
        return self.gap < MARGIN


def orderings(tables: list[Table]) -> list[Ordering]:
    """Every ordering of paper.ARGUMENTS whose two rows are in one of the tables, p-values corrected together.

    The direction is that of the printed values, also where they contradict the paper's words; columns where it prints
    the same value twice are passed over.
    """
    found: dict[tuple[str, str, str], Ordering] = {}
    for table in tables:
        rows = {row.name: row.cells for row in table.rows if not row.baseline}
        for first, second, _ in ARGUMENTS:
            for column in COLUMNS:
                key, values = (first, second, column), [printed(row).get(column) for row in (first, second)]
                if key in found or None in values or values[0] == values[1]:
                    continue
                if any(row not in rows or column not in rows[row] for row in (first, second)):
                    continue
                argued = sign(column) * (values[0] - values[1]) < 0
                better, worse = (first, second) if argued else (second, first)
                here = compared(column, rows[better][column].estimate, rows[worse][column].estimate)
                gap = abs(values[0] - values[1]) / max(values)
                found[key] = Ordering(better, worse, argued, gap, here)
    correct([one.here for one in found.values()])
    return list(found.values())
