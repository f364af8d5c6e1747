"""What a difference between two rows amounts to, and which of the paper's orderings hold here."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from relight.evaluation.paper import ARGUMENTS, printed
from relight.evaluation.statistics import ALPHA, Difference, Estimate, compare, holm
from relight.evaluation.tables import MAPS, Table, sign

MARGIN = 0.035  # relative: smaller differences count as none; most of those that the paper prints are smaller


class Verdict(Enum):
    """The first of two rows against the second, by tests at ALPHA over all comparisons that are read together."""

    BETTER = "better"
    WORSE = "worse"
    EQUIVALENT = "equivalent"  # their difference is shown to be under MARGIN
    OPEN = "open"  # these figures and lights cannot tell

    @property
    def sure(self) -> bool:
        """Whether it says which row is better."""
        return self in (Verdict.BETTER, Verdict.WORSE)


@dataclass
class Comparison:
    """Two rows in one column.

    Attributes:
        column: of the scores.
        first, second: the means of the rows.
        difference: first minus second.
        p, p_equivalent: of "they are equal" and of "they differ by MARGIN or more"; `correct` corrects both.
    """

    column: str
    first: float
    second: float
    difference: Difference
    p: float
    p_equivalent: float

    @property
    def verdict(self) -> Verdict:
        """BETTER or WORSE at ALPHA, EQUIVALENT where the difference is less than MARGIN at ALPHA, else OPEN."""
        if self.p < ALPHA and not self.difference.low <= 0 <= self.difference.high:
            return Verdict.BETTER if sign(self.column) * self.difference.mean < 0 else Verdict.WORSE
        return Verdict.EQUIVALENT if self.p_equivalent < ALPHA else Verdict.OPEN

    @property
    def gain(self) -> float:
        """How much better the first row is, relative to the mean of the second."""
        return self._relative(self.difference.mean)

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of `gain`, the second row's mean being taken as known."""
        low, high = sorted(map(self._relative, (self.difference.low, self.difference.high)))
        return low, high

    @property
    def bound(self) -> float:
        """The least margin, relative to the mean of both rows, at which they are equivalent at ALPHA, read alone."""
        level = (abs(self.first) + abs(self.second)) / 2
        return self.difference.bound(ALPHA) / level if level else np.inf

    def _relative(self, difference: float) -> float:
        return -sign(self.column) * difference / abs(self.second) if self.second else 0.0


def compare_estimates(column: str, first: Estimate, second: Estimate) -> Comparison:
    """Compares two estimates of a column alone, without correction."""
    difference = compare(first, second)
    equivalent = difference.p_equivalent(MARGIN * (abs(first.mean) + abs(second.mean)) / 2)
    return Comparison(column, first.mean, second.mean, difference, difference.p, equivalent)


def correct(found: list[Comparison]) -> list[Comparison]:
    """Corrects the p-values of comparisons that are read together, in place (Holm)."""
    for name in ("p", "p_equivalent"):
        for one, p in zip(found, holm([getattr(one, name) for one in found])):
            setattr(one, name, float(p))
    return found


def compare_rows(
    table: Table, first: str, second: str, columns: tuple[str, ...], other: Table | None = None
) -> dict[str, Comparison]:
    """Compares two rows in some columns, p-values corrected together.

    Args:
        table: holds the first row.
        first, second: names of rows.
        columns: to be compared.
        other: holds the second row, if not `table`: the same rows on other figures or lights.

    Returns:
        Column -> comparison, for the columns that both have; none where a row is missing.
    """
    one, two = table.rows.get(first, {}), (other or table).rows.get(second, {})
    found = [compare_estimates(c, one[c], two[c]) for c in columns if c in one and c in two]
    return {comparison.column: comparison for comparison in correct(found)}


@dataclass
class Ordering:
    """Two rows in the order in which the paper prints them in a column, and the same comparison here.

    Attributes:
        better, worse: the rows, by the printed values.
        argued: whether that is the order of the paper's argument; its tables print some the other way round.
        gap: the relative difference of the two printed values.
        here: the comparison of the two rows.
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
    """Compares the rows of every ordering of `paper.ARGUMENTS` that a table has, p-values corrected together.

    The direction is that of the printed values, also where they contradict the paper's words; columns where it prints
    the same value twice are passed over. An ordering that several tables have is taken from the first.
    """
    found: dict[tuple[str, str, str], Ordering] = {}
    for table in tables:
        for first, second, _ in ARGUMENTS:
            for column in MAPS:
                key, (one, two) = (first, second, column), (printed(row).get(column) for row in (first, second))
                if key in found or one is None or two is None or one == two:
                    continue
                if any(row not in table.networks or column not in table.rows[row] for row in (first, second)):
                    continue
                argued = sign(column) * (one - two) < 0
                better, worse = (first, second) if argued else (second, first)
                here = compare_estimates(column, table.rows[better][column], table.rows[worse][column])
                found[key] = Ordering(better, worse, argued, abs(one - two) / max(one, two), here)
    correct([ordering.here for ordering in found.values()])
    return list(found.values())
