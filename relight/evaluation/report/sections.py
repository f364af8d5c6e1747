"""The numbers of the sections about tables of trainings; their words are in templates/sections."""

from collections import Counter, defaultdict
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from relight.evaluation import charts
from relight.evaluation.comparisons import (
    Comparison,
    Ordering,
    Verdict,
    compare_estimates,
    compare_rows,
    correct,
    orderings,
)
from relight.evaluation.formats import (
    SIGNS,
    Grid,
    bound,
    comparison_grid,
    effect,
    number,
    other_columns,
    p_value,
    percent,
    score_grid,
    write_tables,
)
from relight.evaluation.labels import column_label, label
from relight.evaluation.occlusion import read_occlusion
from relight.evaluation.paper import ARGUMENTS
from relight.evaluation.report.page import text
from relight.evaluation.report.results import Results
from relight.evaluation.tables import Table

ERRORS = ("shading_rmse", "transport_rmse", "albedo_rmse", "light_rmse")
PARTS = ("shading_rmse", "shading_true_light_rmse", "transport_rmse", "light_rmse", "albedo_rmse")
AXES = {"train.figures": "number of training figures", "model.width": "width", "model.order": "order"}
SETS = {"min": "four losses", "full": "fifteen losses", "weighted": "fifteen, transport × 4"}  # of `steps`
SMALL = " †"  # marks differences that the paper prints and that are under MARGIN
HERE = {  # what became of an ordering of the paper
    Verdict.BETTER: "holds",
    Verdict.WORSE: "reversed",
    Verdict.EQUIVALENT: "equivalent",
    Verdict.OPEN: "open",
}
QUARTERS = 8  # test figures that a division into quarters needs
LEADS = (("ours_full", "sfsnet_ao"), ("ours_min", "sfsnet_ao"), ("ours_full", "sfsnet"))  # compared in each quarter
Numbers = dict[str, Any]
Found = dict[str, dict[str, Comparison]]  # what is compared -> column -> comparison


def experiment(results: Results, name: str) -> Numbers:
    """Collects what the section of any table of trainings shows, and what its own words need.

    Args:
        results: of the run.
        name: of the experiment.

    Returns:
        What templates/sections/experiment.md takes, and what the template of the experiment takes beside it.
    """
    table, one = results.table(name), results.experiments[name]
    made: Numbers = {"name": name, "experiment": one, "scored": table, "grid": None, "plot": None, "plates": []}
    if not table.rows:
        return made
    made |= {"grid": score_grid(table, table.columns), "others": score_grid(table, other_columns(table))}
    made |= {"quarters": None, **quarters(results, name)}
    if one["axis"]:
        made["plot"] = results.report / f"{name}.png"
        errors = tuple(column for column in table.columns if column.endswith("rmse"))
        axis = AXES.get(one["axis"], one["axis"])
        charts.plot_axis(points(results, name), table, errors, axis, made["plot"])
    if one["plates"]:
        made["plates"] = [results.report / f"{name}_{kind}.png" for kind in ("plates", "relit", "extremes")]
    return made | EXPERIMENTS.get(name, lambda *_: {})(results, name, table)


def write_score_table(table: Table, title: str, stem: Path) -> None:
    """Writes a table as stem.csv (every column), stem.md and stem.tex."""
    note = text("note.md", scored=table)
    if table.rows:
        shown, others = score_grid(table, table.columns), score_grid(table, other_columns(table))
    else:
        shown, others = Grid.of(["row", "nothing to compare"], []), None
    write_tables(stem, title, note, shown, table.statistics(), others)


def compare_pairs(table: Table, pairs: dict[tuple[str, str], str], columns: tuple[str, ...]) -> Found:
    """Compares pairs of rows.

    Args:
        table: holds the rows.
        pairs: (first, second) -> what the comparison tells.
        columns: to be compared.

    Returns:
        The comparisons of the pairs that the table has.
    """
    found = {
        f"{label(first)} against {label(second)}: {tells}": compare_rows(table, first, second, columns)
        for (first, second), tells in pairs.items()
    }
    return {words: ones for words, ones in found.items() if ones}


def table1(results: Results, name: str, table: Table) -> Numbers:
    """Transport beside what needs no picture, and Ours (min) beside the network with AO and the same losses."""
    found = compare_pairs(table, {(row, "mean_figure"): "transport" for row in table.networks}, ("transport_rmse",))
    found |= compare_pairs(table, {("ours_min", "sfsnet_ao"): "with equal losses"}, ERRORS)
    return {"comparisons": comparison_grid(found)}


def equal_losses(results: Results, name: str, table: Table) -> Numbers:
    """What is inferred with equal losses, and the losses with what is inferred being equal.

    `parts`: of the lead of Ours (full) over SfSNet-AO in shading, relative to SfSNet-AO, the part of the losses (the
    mean of both ways) and that of what is inferred; None where not all four are trained.
    """
    pairs = {
        ("ours_min", "sfsnet_ao"): "what is inferred, four losses",
        ("ours_full", "sfsnet_ao_full"): "what is inferred, fifteen losses",
        ("sfsnet_ao_full", "sfsnet_ao"): "the losses, ambient occlusion",
        ("ours_full", "ours_min"): "the losses, transport",
        ("ours_full", "sfsnet_ao"): "both, as in Table 1",
    }
    rows, parts = ("sfsnet_ao", "sfsnet_ao_full", "ours_min", "ours_full"), None
    if all(row in table.rows for row in rows):
        ao, ao_full, least, full = (table.rows[row]["shading_rmse"].mean for row in rows)
        parts = {"inferred": (ao - least + ao_full - full) / 2 / ao, "losses": (ao - ao_full + least - full) / 2 / ao}
    return {"parts": parts, "comparisons": comparison_grid(compare_pairs(table, pairs, ERRORS))}


def plus_parts(results: Results, name: str, table: Table) -> Numbers:
    """Ours plus against itself without each of its parts; `costly`: the parts that some error gets worse without."""
    without = [row for row in table.networks if row not in ("ours_plus", "ours_full")]
    pairs = {("ours_plus", row): "the part is worth" for row in [*without, "ours_full"]}
    costly = [label(row) for row in without if better(compare_rows(table, "ours_plus", row, ERRORS))]
    grid = comparison_grid(compare_pairs(table, pairs, ERRORS))
    return {"comparisons": grid, "costly": costly, "without": len(without)}


def relit(results: Results, name: str, table: Table) -> Numbers:
    """Relit pictures beside the picture as it is, and what occlusion is worth in them."""
    columns = ("relit_rmse", "relit_ssim")
    pairs = {(row, "as_it_is"): "relighting" for row in table.networks} | dict.fromkeys(LEADS, "in relit pictures")
    worth = [
        label(row) for row in table.networks if "relit_rmse" in better(compare_rows(table, row, "as_it_is", columns))
    ]
    return {"comparisons": comparison_grid(compare_pairs(table, pairs, columns)), "worth": worth}


def baked(results: Results, name: str, table: Table) -> Numbers:
    """The orders of the methods that the paper argues with, on these figures."""
    pairs = {(first, second): tells for first, second, tells in ARGUMENTS}
    return {"comparisons": comparison_grid(compare_pairs(table, pairs, ERRORS))}


def sitting(results: Results, name: str, table: Table) -> Numbers:
    """Sitting against standing test figures, and against what looks at no picture."""
    standing, first = results.table(name, usual=True), table.networks[0]
    found = {
        f"{label(row)}, sitting against standing": compare_rows(table, row, row, ERRORS, standing)
        for row in table.networks
    }
    trivial = compare_rows(table, first, "mean_figure", ERRORS[:3])  # its light is the mean one of any figure
    grid = comparison_grid({**found, f"{label(first)} against the mean figure": trivial})
    return {
        "standing": standing.figures,
        "comparisons": grid,
        "first": first,
        "trivial": len(better(trivial)),
    }


def unusual_lights(results: Results, name: str, table: Table) -> Numbers:
    """Unusual against usual lights; the light beside a training light; richer training lights."""
    usual, first, rich = results.table(name, usual=True), table.networks[0], "ours_rich"
    against = compare_rows(table, first, first, ERRORS, usual)
    nearest = compare_rows(table, first, "nearest_light", ("light_rmse",))
    found = {
        f"{label(first)}, unusual against usual lights": against,
        f"{label(first)} against the nearest training light": nearest,
    }
    if rich in table.rows:
        for one, lights in ((table, "unusual"), (usual, "usual")):
            found[f"{label(rich)} against {label(first)}, {lights} lights"] = compare_rows(one, rich, first, ERRORS)
    shares = {
        row: [one.rows[row]["light_rmse"].mean / one.rows["mean_light"]["light_rmse"].mean for one in (table, usual)]
        for row in table.networks
    }
    return {
        "first": first,
        "usual": usual.lights,
        "fails": {column: one.verdict is Verdict.WORSE for column, one in against.items()},
        "nearest": nearest["light_rmse"].verdict,
        "share": shares[first],
        "shares": Grid.of(
            ["light error over that of the mean training light", "unusual lights", "usual lights"],
            [[label(row), *two] for row, two in shares.items()],
            digits={"unusual lights": 2, "usual lights": 2},
        ),
        "comparisons": comparison_grid(found),
    }


def silhouette(results: Results, name: str, table: Table) -> Numbers:
    """How far the mask alone goes from the mean figure toward what the picture tells."""
    columns, rows = ("transport_rmse", "shading_true_light_rmse"), ("mean_figure", "silhouette", "transport_only")
    others = ("mean_figure", "no_occlusion", "transport_only")
    found = {
        f"{label('silhouette')} against {label(row)}": compare_rows(table, "silhouette", row, columns) for row in others
    }
    part = None
    if all(row in table.rows for row in rows) and better(
        compare_rows(table, "transport_only", "mean_figure", ("transport_rmse",))
    ):
        low, middle, high = (table.rows[row]["transport_rmse"].mean for row in rows)
        part = (low - middle) / (low - high)
    tells = "transport_rmse" in better(compare_rows(table, "silhouette", "mean_figure", columns))
    return {"comparisons": comparison_grid(found), "tells": tells, "part": part}


def self_supervised(results: Results, name: str, table: Table) -> Numbers:
    """Whether fine-tuning on pictures without truth bleaches the shading and makes the albedo the picture.

    `collapsed`: row -> how many of the two signs are there, tested together (Holm).
    """
    base, *tuned = table.networks
    contrast, share = (results.estimates(name, column) for column in ("shading_contrast", "albedo_share"))
    true = share["nearest_light"].mean  # the baseline is given the true albedo
    collapsed, found = {}, {}
    for row in tuned:
        flat, full = correct([compare_estimates("", one[row], one[base]) for one in (contrast, share)])
        flatter = flat.verdict.sure and flat.difference.mean < 0 and flat.first < 1
        fuller = full.verdict.sure and full.difference.mean > 0 and full.first > true
        collapsed[row] = flatter + fuller
        found[f"{label(row)} against {label(base)}"] = compare_rows(table, row, base, PARTS)
    rows = [[label(row), contrast[row], share[row]] for row in table.networks]
    rows.append(["truth", 1.0, true])
    signs = Grid.of(["", "contrast of the shading", "share explained by the albedo"], rows)
    return {"signs": signs, "collapsed": collapsed, "comparisons": comparison_grid(found)}


def splits(results: Results, name: str, table: Table) -> Numbers:
    """What it is worth to have seen the person of the test in training."""
    found = compare_rows(table, "ours_siblings", "ours_disjoint", PARTS)
    grid = comparison_grid({"person seen against not seen": found})
    return {"comparisons": grid, "flattered": len(better(found)), "of": len(found)}


def along(results: Results, name: str, table: Table) -> Numbers:
    """The first and the last point of an axis, and the last step: whether more still helps."""
    found = points(results, name)
    ends = dict.fromkeys([(0, len(found) - 1), (len(found) - 2, len(found) - 1)]) if len(found) > 1 else {}
    rows = {
        f"{found[b][0]:g} against {found[a][0]:g}": compare_rows(table, found[b][1], found[a][1], ERRORS)
        for a, b in ends
    }
    axis, last = AXES.get(results.experiments[name]["axis"]), list(rows.values())[-1] if rows else {}
    places = [place for place, _ in found]
    return {"axis": axis, "places": places, "falling": better(last), "comparisons": comparison_grid(rows)}


def order(results: Results, name: str, table: Table) -> Numbers:
    """What each order can show at best, and what its network shows."""
    found, rows = points(results, name), []
    for place, row in found:
        if cut := table.rows.get(f"cut_{place:.0f}"):
            own, floor = table.rows[row]["shading_rmse"].mean, cut["shading_rmse"].mean
            rows.append([label(row), own, floor, f"{100 * (floor / own) ** 2:.0f} %"])
    steps = {
        f"order {b:g} against {a:g}": compare_rows(table, two, one, ERRORS) for (a, one), (b, two) in pairwise(found)
    }
    heads = ["", "shading RMSE", "of the cut alone", "share of the squared error"]
    return {"floors": Grid.of(heads, rows), "comparisons": comparison_grid(steps)}


def steps(results: Results, name: str, table: Table) -> Numbers:
    """The sets of losses beside each other at each length of training, and each with itself trained longer; `changed`:
    the columns in which one set leads another at one length and trails it at another."""
    rows, found, verdicts = {}, {}, defaultdict(set)
    for row in table.networks:
        rows[row.removeprefix("ours_").split("_")[0], int(results.setting(row, "train.steps"))] = row
    lengths = sorted({length for _, length in rows})
    for first, second in (("full", "min"), ("weighted", "full"), ("weighted", "min")):
        for length in lengths:
            if (first, length) in rows and (second, length) in rows:
                two = rows[first, length], rows[second, length]
                compared = compare_rows(table, *two, ERRORS)
                found[f"{length:,} steps: {SETS[first]} against {SETS[second]}"] = compared
                for column, comparison in compared.items():
                    verdicts[column, first, second].add(comparison.verdict)
    for losses, words in SETS.items():
        for a, b in pairwise(length for length in lengths if (losses, length) in rows):
            two = rows[losses, b], rows[losses, a]
            found[f"{words}: {b:,} against {a:,} steps"] = compare_rows(table, *two, ERRORS)
    turned = {column for (column, *_), seen in verdicts.items() if {Verdict.BETTER, Verdict.WORSE} <= seen}
    return {"comparisons": comparison_grid(found), "changed": [column for column in ERRORS if column in turned]}


EXPERIMENTS: dict[str, Callable[[Results, str, Table], Numbers]] = {
    "table1": table1,
    "equal_losses": equal_losses,
    "plus_parts": plus_parts,
    "steps": steps,
    "relit": relit,
    "baked": baked,
    "silhouette": silhouette,
    "self_supervised": self_supervised,
    "sitting": sitting,
    "unusual_lights": unusual_lights,
    "splits": splits,
    "order": order,
    "data_size": along,
    "width": along,
}


def better(found: dict[str, Comparison]) -> list[str]:
    """The columns in which the first row is better."""
    return [column for column, one in found.items() if one.verdict is Verdict.BETTER]


def points(results: Results, name: str) -> list[tuple[float, str]]:
    """Places the networks of an experiment on its axis.

    Returns:
        Place and row, in the order of the axis; of training figures, as many as there were.
    """
    axis = results.experiments[name]["axis"]
    found = []
    for row in results.table(name).networks:
        place = results.setting(row, axis)
        if axis == "train.figures":
            there = len(results.split(name, row)[results.setting(row, "train.part")])
            place = min(place or there, there)
        found.append((float(place), row))
    return sorted(found, key=lambda point: point[0])


def quarters(results: Results, name: str) -> Numbers:
    """Compares the rows over quarters of the test figures, from the least to the most occluded.

    Args:
        results: of the run; the errors are written beside its report.
        name: of the experiment.

    Returns:
        The errors of each row, how far apart the methods are in each quarter, and the stem of the files; empty where
        there are too few figures, or their occlusion is not known.
    """
    file, rows = results.report / "occlusion.csv", results.scores(name)
    figures = next(iter(rows.values()))[0].figures
    if len(figures) < QUARTERS or not file.exists():
        return {}
    lost = read_occlusion(file).set_index("name")["lost"].reindex(figures)
    if lost.isna().any():
        return {}
    parts = np.array_split(np.argsort(lost.to_numpy(), kind="stable"), 4)
    heads = [
        f"{what}, {number(float(lost.iloc[part].mean()), 2)} lost"
        for what, part in zip(("least", "second", "third", "most"), parts)
    ]
    tables = {head: results.part(name, part) for head, part in zip(heads, parts)}
    some = tables[heads[0]]
    columns = {
        (column_label(column), head): [cells.get(column) for cells in table.rows.values()]
        for column in some.present(some.columns)
        if column.endswith("rmse")
        for head, table in tables.items()
    }
    frame = pd.DataFrame(columns, pd.Index(map(label, some.rows), name="row"), dtype=object)
    shown = Grid(frame.where(frame.notna(), None), [some.kind(row) for row in some.rows])
    leads = {
        f"{label(first)} against {label(second)}, {head}": compare_rows(table, first, second, ("shading_rmse",))
        for first, second in LEADS
        for head, table in tables.items()
    }
    correct([one for found in leads.values() for one in found.values()])
    stem, title = f"{name}_occlusion", f"{results.title(name)}, by occlusion"
    write_tables(results.report / stem, title, text("notes/quarters.md"), shown)
    return {"quarters": shown, "leads": comparison_grid(leads), "quarters_file": stem}


def summary(results: Results) -> Numbers:
    """Which of the paper's orderings hold here: how many, which, and with what numbers."""
    tables = [results.table(name) for name in results.readable if results.usual(name)]
    tables = [table for table in tables if table.rows]
    found, counts = orderings(tables), [count for table in tables for count in table.trainings.values()]
    verdicts = Counter(one.here.verdict for one in found)
    lines = [
        [
            f"{label(one.better)} before {label(one.worse)}",
            column_label(one.here.column),
            f"{100 * one.gap:.1f} %{SMALL * one.small}{' *' * (not one.argued)}",
            *effect(one.here),
            *(number(value) for value in (one.here.first, one.here.second)),
            p_value(one.here.p),
            f"{SIGNS[one.here.verdict]} {HERE[one.here.verdict]}",
            bound(one.here),
        ]
        for one in found
    ]
    heads = ["the paper prints", "in", "by", "here by", "95 % interval", "first", "second", "p", "here", "within"]
    return {
        "tables": tables,
        "orderings": found,
        "verdicts": verdicts,
        "small": sum(one.small for one in found),
        "trainings": (min(counts, default=0), max(counts, default=0)),
        "matrix": matrix(found),
        "listed": Grid.of(heads, lines),
    }


def matrix(found: list[Ordering]) -> Grid:
    """A row per pair that the paper argues with, a column per quantity: the verdict and the relative gain."""
    columns = list(dict.fromkeys(one.here.column for one in found))
    lines = []
    for first, second, _ in ARGUMENTS:
        of_pair = {one.here.column: one for one in found if {one.better, one.worse} == {first, second}}
        if of_pair:
            cells = [of_pair.get(column) for column in columns]
            lines.append([f"{label(first)} against {label(second)}", *(one and mark(one) for one in cells)])
    return Grid.of(["", *map(column_label, columns)], lines)


def mark(one: Ordering) -> str:
    """A cell of the matrix: how much better the pair's first row is here, in percent; in brackets where the paper's
    numbers are against its argument, with a mark where they differ by less than MARGIN."""
    gain = percent(one.here.gain if one.argued else -one.here.gain).removesuffix(" %")
    words = f"{SIGNS[one.here.verdict]} {gain}{SMALL * one.small}"
    return words if one.argued else f"({words})"
