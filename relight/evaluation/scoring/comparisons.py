"""Compares rows of tables, and tests which of the paper's orderings hold."""

from dataclasses import dataclass
from enum import Enum
from itertools import product

import numpy as np

from relight.evaluation.scoring.paper import ARGUMENTS, printed
from relight.evaluation.scoring.statistics import ALPHA, Estimate, compare, holm
from relight.evaluation.scoring.tables import TABLE2_COLUMNS, Table
from relight.settings.scores import sign

# Relative; rows are equivalent if they differ by less; most differences that the paper prints are smaller.
MARGIN = 0.035


class Verdict(Enum):
    """The result of comparing a first row with a second one, at significance level ALPHA."""

    BETTER = "better"
    WORSE = "worse"
    DIFFERENT = "different"  # in a column without `sign`
    EQUIVALENT = "equivalent"  # the difference is significantly smaller than MARGIN
    OPEN = "open"  # neither a difference nor equivalence is significant

    @property
    def is_significant(self) -> bool:
        """Whether the rows differ significantly."""
        return self not in (Verdict.EQUIVALENT, Verdict.OPEN)


class Comparison:
    """The comparison of two rows in one column.

    Attributes:
        column: of the scores.
        first, second: the means of the rows.
        difference: first minus second.
        p: p-value of the hypothesis that they are equal; `correct` corrects it.
        p_equivalent: p-value of the hypothesis that they differ by MARGIN or more; `correct` corrects it.
        level: at which `p` before the correction is tested, so that `interval` holds zero exactly if p >= ALPHA.
    """

    def __init__(self, column: str, first: Estimate, second: Estimate):
        """Compares two estimates of a column, without correction for the number of comparisons."""
        self.column, self.first, self.second = column, first.mean, second.mean
        self.difference = compare(first, second)
        self.p, self.level = self.difference.p, ALPHA
        self.p_equivalent = self.difference.p_equivalent(MARGIN * (abs(self.first) + abs(self.second)) / 2)

    @property
    def verdict(self) -> Verdict:
        """What the first is if they differ significantly; EQUIVALENT if they do by less than MARGIN; else OPEN."""
        if self.p >= ALPHA:
            return Verdict.EQUIVALENT if self.p_equivalent < ALPHA else Verdict.OPEN
        worse = sign(self.column) * self.difference.mean
        return Verdict.BETTER if worse < 0 else Verdict.WORSE if worse > 0 else Verdict.DIFFERENT

    @property
    def gain(self) -> float:
        """How much better the first row is, relative to the second; or larger, without `sign`."""
        return self._relative(self.difference.mean)

    @property
    def interval(self) -> tuple[float, float]:
        """The ends of the interval of `gain` at `level`; the uncertainty of the second mean as divisor is ignored."""
        mean, half_width = self.difference.mean, self.difference.half_width(self.level)
        low, high = sorted(map(self._relative, (mean - half_width, mean + half_width)))
        return low, high

    @property
    def bound(self) -> float:
        """The least margin, relative to the mean of both rows, at which they are equivalent, without correction."""
        level = (abs(self.first) + abs(self.second)) / 2
        return self.difference.bound(ALPHA) / level if level else np.inf

    def _relative(self, difference: float) -> float:
        """Returns a difference first minus second over the second mean, positive if `gain` is."""
        return -(sign(self.column) or -1) * difference / abs(self.second) if self.second else 0.0


def correct(comparisons: list[Comparison]) -> list[Comparison]:
    """Corrects p-values and levels for the number of comparisons (Holm), in place, and returns the comparisons."""
    p = holm([comparison.p for comparison in comparisons])
    p_equivalent = holm([comparison.p_equivalent for comparison in comparisons])
    for comparison, corrected, equivalent in zip(comparisons, p.tolist(), p_equivalent.tolist()):
        # The level at which the uncorrected p-value has the same verdict as the corrected one at ALPHA.
        comparison.level = ALPHA * comparison.p / corrected if corrected else ALPHA / len(comparisons)
        comparison.p, comparison.p_equivalent = corrected, equivalent
    return comparisons


def compare_rows(
    table: Table, first: str, second: str, columns: tuple[str, ...], other: Table | None = None
) -> dict[str, Comparison]:
    """Compares two rows in those columns that both have, with p-values corrected over these.

    The second is of the table `other`, by default of the same. Without one of them there are no comparisons.
    """
    cells, other_cells = table.rows.get(first, {}), (other or table).rows.get(second, {})
    shared = [column for column in columns if column in cells and column in other_cells]
    comparisons = [Comparison(column, cells[column], other_cells[column]) for column in shared]
    return {comparison.column: comparison for comparison in correct(comparisons)}


@dataclass
class Ordering:
    """Two rows in the order of the paper's printed values in a column, and their comparison in this run.

    Attributes:
        better, worse: the rows, by the printed values.
        argued: whether the printed order agrees with the paper's argument.
        printed_difference: the relative difference of the two printed values.
        comparison: `better` against `worse` in this run.
    """

    better: str
    worse: str
    argued: bool
    printed_difference: float
    comparison: Comparison

    @property
    def below_margin(self) -> bool:
        """Whether the printed difference is under MARGIN."""
        return self.printed_difference < MARGIN


def orderings(tables: list[Table]) -> list[Ordering]:
    """Compares the rows of every ordering of `paper.ARGUMENTS` that a table has, with p-values corrected over all.

    The direction is that of the printed values, even if they contradict the paper's argument. Columns with equal
    printed values are skipped. An ordering that several tables have is taken from the first.
    """
    tested: dict[tuple[str, str, str], Ordering] = {}
    for table, (leader, follower, _), column in product(tables, ARGUMENTS, TABLE2_COLUMNS):
        key = (leader, follower, column)
        if key not in tested and (ordering := _printed_ordering(table, *key)):
            tested[key] = ordering
    correct([ordering.comparison for ordering in tested.values()])
    return list(tested.values())


def _printed_ordering(table: Table, leader: str, follower: str, column: str) -> Ordering | None:
    """Compares two rows, the better one by the paper's argument first, in the order of their printed values.

    The comparison is not corrected. None if the table or the paper lacks a value, or the paper's are equal.
    """
    first, second = (printed(row).get(column) for row in (leader, follower))
    if first is None or second is None or first == second:
        return None
    if not all(row in table.networks and column in table.rows[row] for row in (leader, follower)):
        return None
    argued = sign(column) * (first - second) < 0
    better, worse = (leader, follower) if argued else (follower, leader)
    comparison = Comparison(column, table.rows[better][column], table.rows[worse][column])
    return Ordering(better, worse, argued, abs(first - second) / max(first, second), comparison)
