"""Comparisons in plain words, for the paragraphs of the report."""

from relight.evaluation.formats import QUANTITY, READING, number, split_column
from relight.evaluation.statistics import Difference, Estimate, holm
from relight.evaluation.tables import ALPHA, Row, Table, sign

# (first mean, second mean, their difference) of a column
Compared = dict[str, tuple[float, float, Difference]]


def row(table: Table, name: str) -> Row | None:
    """The row of a network or a baseline, if the table has it."""
    return next((one for one in table.rows if one.name == name), None)


def paired(first: Row, second: Row, columns: tuple[str, ...], how) -> Compared:
    """What two rows have in `columns`, compared by `how`: `statistics.compare` for the same figures."""
    both = [column for column in columns if column in first.cells and column in second.cells]
    return {c: compared(first.cells[c].estimate, second.cells[c].estimate, how) for c in both}


def compared(first: Estimate, second: Estimate, how) -> tuple[float, float, Difference]:
    return first.mean, second.mean, how(first, second)


def told(found: Compared) -> str:
    """Each column's two means, and which is better: `x (.1 against .2, better by .05 to .15, p = .01), y (...)`.

    p-values are corrected together (Holm); where nothing can be told, the interval of the difference says how little.
    """
    return ", ".join(
        f"{named(column)} ({number(first)} against {number(second)}, {verdict(column, difference, p)})"
        for (column, (first, second, difference)), p in zip(found.items(), corrected(found))
    )


def corrected(found: Compared) -> list[float]:
    return [float(p) for p in holm([difference.p for _, _, difference in found.values()])]


def verdict(column: str, difference: Difference, p: float) -> str:
    low, high = sorted((abs(difference.low), abs(difference.high)))
    if p >= ALPHA or difference.low <= 0 <= difference.high:
        return f"not to be told apart: {signed(difference)}"
    better = "better" if sign(column) * difference.mean < 0 else "worse"
    return f"{better} by {number(low)} to {number(high)}, {'p < .001' if p < 0.001 else f'p = {number(p)}'}"


def signed(difference: Difference) -> str:
    """The interval of a difference, with signs."""
    return " to ".join("−" * (end < 0) + number(abs(end)) for end in (difference.low, difference.high))


def outcome(found: Compared) -> dict[str, str]:
    """Column -> `better`, `worse` or `open`, of the first against the second."""
    return {
        column: "open" if verdict(column, d, p).startswith("not") else verdict(column, d, p).split()[0]
        for (column, (_, _, d)), p in zip(found.items(), corrected(found))
    }


def named(column: str) -> str:
    quantity, reading = split_column(column)
    return f"{QUANTITY[quantity].lower()} {READING[reading]}"
