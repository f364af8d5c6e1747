"""Which of the paper's orderings hold here: the pairs of rows that its text argues with, tested on our scores."""

from dataclasses import dataclass

from relight.evaluation.formats import QUANTITY, READING, count, number, split_column
from relight.evaluation.page import grid
from relight.evaluation.paper import printed
from relight.evaluation.statistics import Difference, compare, holm
from relight.evaluation.tables import ALPHA, LABELS, Table, sign

# (the better row in the paper's words, the worse, what it shows): section 6.1 and Table 2's discussion.
PAIRS = (
    ("ours_min", "sfsnet", "knowing occlusion helps"),
    ("ours_full", "sfsnet", "knowing occlusion helps"),
    ("ours_full", "sfsnet_ao", "transport beats ambient occlusion"),
    ("ours_full", "ours_min", "the fifteen losses beat four"),
    ("ours_full", "no_tv", "total variation matters"),
    ("ours_full", "no_shading", "the shading losses matter"),
    ("ours_full", "no_reconstruction", "the reconstruction losses matter"),
)
COLUMNS = tuple(f"{q}_{reading}" for q in ("shading", "transport", "light", "albedo") for reading in ("rmse", "ssim"))
SIGNS = {"holds": "✓", "reversed": "✗", "open": "?"}


@dataclass
class Claim:
    """One ordering of the paper: `better` before `worse` in `column`, by the values it prints; ours: better - worse."""

    better: str
    worse: str
    column: str
    ours: Difference
    means: tuple[float, float]
    p: float

    @property
    def verdict(self) -> str:
        """`holds`, `reversed`, or `open` where our figures cannot tell."""
        if self.p >= ALPHA or self.ours.low <= 0 <= self.ours.high:
            return "open"
        return "holds" if sign(self.column) * self.ours.mean < 0 else "reversed"


def claims(tables: list[Table]) -> list[Claim]:
    """Every ordering of PAIRS whose two rows are in one of the tables, p-values corrected together (Holm).

    The direction is that of the paper's printed values, also where they contradict its general statement; columns
    where it prints the same value twice are passed over.
    """
    found: dict[tuple, Claim] = {}
    for table in tables:
        rows = {row.name: row.cells for row in table.rows if not row.baseline}
        for first, second, _ in PAIRS:
            for column in COLUMNS:
                values = printed(first).get(column), printed(second).get(column)
                if not (first in rows and second in rows) or None in values or values[0] == values[1]:
                    continue
                swap = sign(column) * (values[0] - values[1]) > 0
                better, worse = (second, first) if swap else (first, second)
                ours = rows[better].get(column), rows[worse].get(column)
                if None not in ours:
                    estimates = [cell.estimate for cell in ours]
                    claim = Claim(better, worse, column, compare(*estimates), tuple(e.mean for e in estimates), 1.0)
                    found.setdefault((first, second, column), claim)
    for claim, p in zip(found.values(), holm([claim.ours.p for claim in found.values()])):
        claim.p = float(p)
    return list(found.values())


def paragraph(tables: list[Table]) -> str:
    """How many of the orderings hold, are reversed, and cannot be decided by these figures; Markdown."""
    made = claims(tables)
    if not made:
        return "No two rows that the paper's tables compare are trained in this run."
    table = tables[0]
    numbers = {row.trainings for one in tables for row in one.rows if not row.baseline}
    trainings = count(max(numbers), "training")
    trainings = trainings if len(numbers) == 1 else f"{min(numbers)} to {trainings}"
    sides = {verdict: [c for c in made if c.verdict == verdict] for verdict in ("holds", "reversed", "open")}
    out = [
        f"The paper's two tables order their rows in {len(made)} comparisons that can be repeated here, on "
        f"{count(table.figures, 'test figure')} under {count(table.lights, 'test light')} with "
        f"{trainings} a row. By paired tests over figures (p < {ALPHA} after Holm's correction for "
        f"all {len(made)}), **{len(sides['holds'])} hold here, {len(sides['reversed'])} the other way round, "
        f"{len(sides['open'])} stay open.**"
    ]
    if numbers == {1}:
        out.append(
            "With one training a row the tests speak of these networks on other figures of this kind; whether another "
            "training would order them so is not known."
        )
    return "\n\n".join(out)


def listed(tables: list[Table]) -> str:
    """Every comparison with its numbers, as an HTML table: what `matrix` holds in signs."""
    rows = []
    for claim in claims(tables):
        quantity, reading = split_column(claim.column)
        low, high = sorted((_gain(claim, claim.ours.low), _gain(claim, claim.ours.high)))
        rows.append(
            [
                f"{SIGNS[claim.verdict]} {claim.verdict}",
                f"{LABELS[claim.better]} before {LABELS[claim.worse]}",
                f"{QUANTITY[quantity].lower()} {READING[reading]}",
                f"{number(claim.means[0])} against {number(claim.means[1])}",
                f"{_signed(low)} to {_signed(high)}",
                "< .0001" if claim.p < 1e-4 else f"{claim.p:.2g}".lstrip("0"),
            ]
        )
    return grid(["here", "order of the paper", "in", "means here", "better by (95 %)", "p"], rows)


def _gain(claim: Claim, difference: float) -> float:
    """How much better the row is that the paper has ahead."""
    return -sign(claim.column) * difference


def _signed(value: float) -> str:
    size = number(abs(value))
    return size if size == number(0.0) else f"{'−' if value < 0 else '+'}{size}"


def matrix(tables: list[Table]) -> str:
    """The same as an HTML table: a row per pair, a column per quantity, each cell the verdict with its difference."""
    made = claims(tables)
    out = [
        "<p class=aside>✓ the paper's order holds, ✗ it is the other way round here, ? these figures cannot tell; the "
        "rows need not be equal. The number is how much better the row's first network is here. In brackets: the "
        "paper's numbers are against its argument, and the sign is about its numbers.</p>\n"
        "<div class=scroll><table class=scores><thead><tr><th scope=col>In the paper's argument"
    ]
    for column in COLUMNS:
        quantity, reading = split_column(column)
        out.append(f"<th scope=col>{QUANTITY[quantity]}<br><small>{READING[reading]}</small>")
    out.append("<tbody>")
    for first, second, words in PAIRS:
        of_pair = {c.column: c for c in made if {c.better, c.worse} == {first, second}}
        if not of_pair:
            continue
        out.append(f'<tr><th scope=row title="{words}">{LABELS[first]} beats {LABELS[second]}')
        for column in COLUMNS:
            if (claim := of_pair.get(column)) is None:
                out.append("<td>")
                continue
            turned = " (printed the other way)" if claim.better != first else ""
            hint = f"{LABELS[claim.better]} before {LABELS[claim.worse]}{turned}: {claim.verdict}, p = {claim.p:.2g}"
            gain = _gain(claim, claim.ours.mean) * (1 if claim.better == first else -1)
            mark = f"({SIGNS[claim.verdict]})" if turned else SIGNS[claim.verdict]
            out.append(f'<td class={claim.verdict} title="{hint}">{mark} <small>{_signed(gain)}</small>')
    return "\n".join([*out, "</table></div>"])
