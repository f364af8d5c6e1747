"""The numbers of the sections about tables of trainings; their words are in templates/sections."""

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from relight.evaluation import charts, occlusion
from relight.evaluation.comparisons import (
    Comparison,
    Ordering,
    Verdict,
    compare_rows,
    compared,
    correct,
    orderings,
)
from relight.evaluation.formats import (
    SIGNS,
    Grid,
    bound,
    column_name,
    comparison_grid,
    effect,
    number,
    other_columns,
    p_value,
    percent,
    score_grid,
    write_tables,
)
from relight.evaluation.paper import ARGUMENTS
from relight.evaluation.report.page import text
from relight.evaluation.report.results import Results
from relight.evaluation.tables import LABELS, Row, Table

MAPS = ("shading_rmse", "transport_rmse", "albedo_rmse")
ERRORS = (*MAPS, "light_rmse")
PARTS = ("shading_rmse", "shading_true_light_rmse", "transport_rmse", "light_rmse", "albedo_rmse")
AXES = {"train.figures": "number of training figures", "model.width": "width", "model.order": "order"}
SMALL = " †"  # marks differences that the paper prints and that are under MARGIN
HERE = {  # what became of an ordering of the paper
    Verdict.BETTER: "the same",
    Verdict.WORSE: "reversed",
    Verdict.EQUIVALENT: "no difference",
    Verdict.OPEN: "undecided",
}
QUARTERS = 8  # test figures that a division into quarters needs
LEADS = (("ours_full", "sfsnet_ao"), ("ours_min", "sfsnet_ao"), ("ours_full", "sfsnet"))  # compared in each quarter
Numbers = dict[str, Any]


def experiment(results: Results, name: str) -> Numbers:
    """What the section of any table of trainings shows, and what its own words need."""
    table, one = results.table(name), results.experiments[name]
    made = {"name": name, "experiment": one, "scored": table, "grid": None, "plot": None, "plates": []}
    if not table.rows:
        return made
    made |= {"grid": score_grid(table, table.columns), "others": score_grid(table, other_columns(table))}
    made |= {"quarters": None, **quarters(results, name)}
    if one["axis"]:
        made["plot"] = results.report / f"{name}.png"
        errors = tuple(column for column in table.columns if column.endswith("rmse"))
        baselines = [row for row in table.rows if row.baseline]
        charts.plot_axis(points(results, name), baselines, errors, AXES.get(one["axis"], one["axis"]), made["plot"])
    if one["plates"]:
        made["plates"] = [results.report / f"{name}_{kind}.png" for kind in ("plates", "extremes")]
    return made | EXPERIMENTS.get(name, lambda *_: {})(results, name)


def write_score_table(table: Table, title: str, stem: Path) -> None:
    """The table as stem.csv (every column), stem.md and stem.tex."""
    note = text("note.md", scored=table)
    if not table.rows:
        empty = Grid.of(["row", "nothing to compare"], [])
        return write_tables(stem, title, note, table.statistics(), empty)
    others = score_grid(table, other_columns(table)).blocks()
    write_tables(stem, title, note, table.statistics(), score_grid(table, table.columns), others)


def table1(results: Results, name: str) -> Numbers:
    """Transport beside what needs no picture, and Ours (min) beside the network with AO and the same losses."""
    table = results.table(name)
    own, trivial = [row for row in table.networks if "transport_rmse" in row.cells], table.row("mean_figure")
    found = {
        f"{row.label} against the mean figure": compare_rows(row, trivial, ("transport_rmse",))
        for row in own
        if trivial
    }
    equal = [table.row("ours_min"), table.row("sfsnet_ao")]
    if all(equal):
        found["Ours (min) against SfSNet-AO, with equal losses"] = compare_rows(*equal, ERRORS)
    return {"comparisons": comparison_grid(found)}


def pairs_of(table: Table, wanted: dict[tuple[str, str], str], columns: tuple[str, ...]) -> Numbers:
    """Comparisons of those pairs of rows that a table has, with what each of them tells."""
    found = {
        f"{LABELS[a]} against {LABELS[b]}: {tells}": compare_rows(table.row(a), table.row(b), columns)
        for (a, b), tells in wanted.items()
        if table.row(a) and table.row(b)
    }
    return {"comparisons": comparison_grid(found), "found": found}


def equal_losses(results: Results, name: str) -> Numbers:
    """What is inferred with equal losses, and the losses with what is inferred being equal.

    parts: of the lead of Ours (full) over SfSNet-AO in shading, relative to SfSNet-AO, the part of the losses (the mean
    of both ways) and that of what is inferred; None where not all four are trained.
    """
    table = results.table(name)
    wanted = {
        ("ours_min", "sfsnet_ao"): "what is inferred, four losses",
        ("ours_full", "sfsnet_ao_full"): "what is inferred, fifteen losses",
        ("sfsnet_ao_full", "sfsnet_ao"): "the losses, ambient occlusion",
        ("ours_full", "ours_min"): "the losses, transport",
        ("ours_full", "sfsnet_ao"): "both, as in Table 1",
    }
    parts = None
    if all(table.row(row) for pair in wanted for row in pair):
        ao, ao_full, least, full = (
            mean(table.row(row), "shading_rmse") for row in ("sfsnet_ao", "sfsnet_ao_full", "ours_min", "ours_full")
        )
        parts = {"inferred": (ao - least + ao_full - full) / 2 / ao, "losses": (ao - ao_full + least - full) / 2 / ao}
    return {"parts": parts, **pairs_of(table, wanted, ERRORS)}


def plus_parts(results: Results, name: str) -> Numbers:
    """Ours plus against itself without each of its parts; costly: the parts that some error gets worse without."""
    table = results.table(name)
    without = [row.name for row in table.networks if row.name not in ("ours_plus", "ours_full")]
    made = pairs_of(table, {("ours_plus", row): "the part is worth" for row in [*without, "ours_full"]}, ERRORS)
    costly = [
        LABELS[row]
        for row, found in zip(without, made["found"].values())
        if any(one.verdict is Verdict.BETTER for one in found.values())
    ]
    return {**made, "costly": costly, "without": len(without)}


def relit(results: Results, name: str) -> Numbers:
    """Relit pictures beside the picture as it is, and what occlusion is worth in them."""
    table, columns = results.table(name), ("relit_rmse", "relit_ssim")
    wanted = {(row.name, "as_it_is"): "relighting" for row in table.networks}
    wanted |= {pair: "in relit pictures" for pair in LEADS}
    made = pairs_of(table, wanted, columns)
    worth = [
        row.label
        for row in table.networks
        if table.row("as_it_is")
        and compare_rows(row, table.row("as_it_is"), columns)["relit_rmse"].verdict is Verdict.BETTER
    ]
    return {**made, "worth": worth}


def baked(results: Results, name: str) -> Numbers:
    """The orders of the methods that the paper argues with, on these figures."""
    wanted = {(a, b): tells for a, b, tells in ARGUMENTS}
    return pairs_of(results.table(name), wanted, ERRORS)


def sitting(results: Results, name: str) -> Numbers:
    """Sitting against standing test figures, and against what looks at no picture."""
    table, standing = results.table(name), results.table(name, usual=True)
    found = {
        f"{row.label}, sitting against standing": compare_rows(row, standing.row(row.name), ERRORS)
        for row in table.networks
    }
    first = table.networks[0]
    trivial = compare_rows(first, table.row("mean_figure"), MAPS)
    grid = comparison_grid({**found, f"{first.label} against the mean figure": trivial})
    return {"standing": standing.figures, "comparisons": grid, "first": first, "trivial": won(trivial)}


def unusual_lights(results: Results, name: str) -> Numbers:
    """Unusual against usual lights; the light beside a training light; richer training lights."""
    table, usual = results.table(name), results.table(name, usual=True)
    first, nearest = table.networks[0], table.row("nearest_light")
    against = compare_rows(first, usual.row(first.name), ERRORS)
    found = compare_rows(first, nearest, ("light_rmse",))
    rows = {
        f"{first.label}, unusual against usual lights": against,
        f"{first.label} against the nearest training light": found,
    }
    if rich := table.row("ours_rich"):
        rows[f"{rich.label} against {first.label}, unusual lights"] = compare_rows(rich, first, ERRORS)
        rows[f"{rich.label} against {first.label}, usual lights"] = compare_rows(
            usual.row(rich.name), usual.row(first.name), ERRORS
        )
    return {
        "first": first,
        "usual": usual.lights,
        "fails": {column: one.verdict is Verdict.WORSE for column, one in against.items()},
        "nearest": found["light_rmse"].verdict,
        "share": [share_of_mean(one, first.name) for one in (table, usual)],
        "shares": Grid.of(
            ["light error over that of the mean training light", "unusual lights", "usual lights"],
            [[row.label, *(share_of_mean(one, row.name) for one in (table, usual))] for row in table.networks],
            **{"unusual lights": 2, "usual lights": 2},
        ),
        "comparisons": comparison_grid(rows),
    }


def share_of_mean(table: Table, name: str) -> float:
    """The light error of a row over that of the mean training light on the same pictures."""
    return mean(table.row(name), "light_rmse") / mean(table.row("mean_light"), "light_rmse")


def silhouette(results: Results, name: str) -> Numbers:
    """How far the mask alone goes from the mean figure toward what the picture tells."""
    table, columns = results.table(name), ("transport_rmse", "shading_true_light_rmse")
    mask, image = table.row("silhouette"), table.row("transport_only")
    others = [table.row("mean_figure"), table.row("no_occlusion"), image]
    found = {f"{mask.label} against {row.label}": compare_rows(mask, row, columns) for row in others if mask and row}
    tells = bool(mask) and compare_rows(mask, others[0], columns)["transport_rmse"].verdict is Verdict.BETTER
    part = None
    if mask and image and won(compare_rows(image, others[0], ("transport_rmse",))):
        low, middle, high = (mean(row, "transport_rmse") for row in (others[0], mask, image))
        part = (low - middle) / (low - high)
    return {"comparisons": comparison_grid(found), "tells": tells, "part": part}


def self_supervised(results: Results, name: str) -> Numbers:
    """Whether fine-tuning on pictures without truth bleaches the shading and makes the albedo the picture.

    `collapsed`: row -> how many of the two signs are there, tested together (Holm).
    """
    table = results.table(name)
    base, *tuned = table.networks
    contrast, share = (results.estimates(name, column) for column in ("shading_contrast", "albedo_share"))
    true = share["nearest_light"].mean  # the baseline is given the true albedo
    collapsed, found = {}, {}
    for row in tuned:
        flat, grown = signs = [compared(c, e[row.name], e[base.name]) for c, e in zip("cs", (contrast, share))]
        correct(signs)
        flatter = sure(flat) and flat.difference.mean < 0 and flat.first < 1
        fuller = sure(grown) and grown.difference.mean > 0 and grown.first > true
        collapsed[row.name] = flatter + fuller
        found[f"{row.label} against {base.label}"] = compare_rows(row, base, PARTS)
    rows = [[row.label, contrast[row.name], share[row.name]] for row in table.networks]
    rows.append(["truth", 1.0, true])
    signs = Grid.of(["", "contrast of the shading", "share explained by the albedo"], rows)
    return {"signs": signs, "collapsed": collapsed, "comparisons": comparison_grid(found)}


def splits(results: Results, name: str) -> Numbers:
    """What it is worth to have seen the person of the test in training."""
    table = results.table(name)
    seen, unseen = table.row("ours_siblings"), table.row("ours_disjoint")
    found = compare_rows(seen, unseen, PARTS) if seen and unseen else {}
    return {
        "comparisons": comparison_grid({"person seen against not seen": found}),
        "flattered": won(found),
        "of": len(found),
    }


def along(results: Results, name: str) -> Numbers:
    """The first and the last point of an axis, and the last step: whether more still helps."""
    found = points(results, name)
    ends = dict.fromkeys([(0, len(found) - 1), (len(found) - 2, len(found) - 1)]) if len(found) > 1 else {}
    rows = {f"{found[b][0]:g} against {found[a][0]:g}": compare_rows(found[b][1], found[a][1], ERRORS) for a, b in ends}
    last = list(rows.values())[-1] if rows else {}
    falling = [column for column, one in last.items() if one.verdict is Verdict.BETTER]
    axis = AXES.get(results.experiments[name]["axis"])
    return {"axis": axis, "places": [x for x, _ in found], "falling": falling, "comparisons": comparison_grid(rows)}


def order(results: Results, name: str) -> Numbers:
    """What each order can show at best, and what its network shows."""
    table, found = results.table(name), points(results, name)
    floors = {row.name: mean(row, "shading_rmse") for row in table.rows if row.name.startswith("cut_")}
    rows = [
        [row.label, mean(row, "shading_rmse"), floor, f"{100 * (floor / mean(row, 'shading_rmse')) ** 2:.0f} %"]
        for place, row in found
        if (floor := floors.get(f"cut_{place:.0f}")) is not None
    ]
    steps = {f"order {b:g} against {a:g}": compare_rows(two, one, ERRORS) for (a, one), (b, two) in pairwise(found)}
    heads = ["", "shading RMSE", "of the cut alone", "share of the squared error"]
    return {"floors": Grid.of(heads, rows), "comparisons": comparison_grid(steps)}


EXPERIMENTS: dict[str, Callable[[Results, str], Numbers]] = {
    "table1": table1,
    "equal_losses": equal_losses,
    "plus_parts": plus_parts,
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


def points(results: Results, name: str) -> list[tuple[float, Row]]:
    """The rows of an experiment's table with their place on its axis, in its order; of training figures, as many as
    there were."""
    axis = results.experiments[name]["axis"]
    found = []
    for row in results.table(name).networks:
        place = results.setting(row.name, axis)
        if axis == "train.figures":
            there = len(results.split(name, row.name)[results.setting(row.name, "train.part")])
            place = min(place or there, there)
        found.append((float(place), row))
    return sorted(found, key=lambda point: point[0])


def quarters(results: Results, name: str) -> Numbers:
    """The errors of each row over quarters of the test figures, from the least to the most occluded, and how far apart
    the methods are in each; both are written beside the report.

    Empty where there are too few figures, or their occlusion is not known.
    """
    file, rows = results.report / "occlusion.csv", results.scores(name)
    figures = next(iter(rows.values()))[0].figures
    if len(figures) < QUARTERS or not file.exists():
        return {}
    lost = pd.Series({one.name: one.lost for one in occlusion.read_occlusions(file)}).reindex(figures)
    if lost.isna().any():
        return {}
    parts = np.array_split(np.argsort(lost.to_numpy(), kind="stable"), 4)
    tables = [results.part(name, part) for part in parts]
    heads = [
        f"{what}, {number(float(lost.iloc[part].mean()), 2)} lost"
        for what, part in zip(("least", "second", "third", "most"), parts)
    ]
    errors = [column for column in tables[0].columns if column.endswith("rmse")]
    grids = [score_grid(table, tuple(errors)) for table in tables]
    frame = pd.concat([grid.frame for grid in grids], axis=1)
    frame.columns = [(column_name(c), head) for head in heads for c in errors]
    frame = frame[[(column_name(c), head) for c in errors for head in heads]]
    frame.columns = pd.MultiIndex.from_tuples(frame.columns)
    kept = [kind != "paper" for kind in grids[0].kinds]
    shown = Grid(frame[kept].rename_axis(index="row"), [kind for kind in grids[0].kinds if kind != "paper"])
    leads = {
        f"{LABELS[a]} against {LABELS[b]}, {head}": compare_rows(table.row(a), table.row(b), ("shading_rmse",))
        for a, b in LEADS
        for head, table in zip(heads, tables)
        if table.row(a) and table.row(b)
    }
    correct([one for found in leads.values() for one in found.values()])
    stem, title = f"{name}_occlusion", f"{results.title(name)}, by occlusion"
    write_tables(results.report / stem, title, text("notes/quarters.md"), shown.statistics(), shown)
    return {"quarters": shown, "leads": comparison_grid(leads), "quarters_file": stem}


def mean(row: Row, column: str) -> float:
    return row.cells[column].estimate.mean


def won(found: dict[str, Comparison]) -> int:
    """In how many columns the first is better."""
    return sum(one.verdict is Verdict.BETTER for one in found.values())


def sure(one: Comparison) -> bool:
    return one.verdict in (Verdict.BETTER, Verdict.WORSE)


def summary(results: Results) -> Numbers:
    """Which of the paper's orderings hold here: how many, which, and with what numbers."""
    tables = [results.table(name) for name in results.readable if results.usual(name)]
    tables = [table for table in tables if table.rows]
    found = orderings(tables)
    verdicts = Counter(one.here.verdict for one in found)
    lines = [
        [
            f"{LABELS[one.better]} before {LABELS[one.worse]}",
            column_name(one.here.column),
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
        "trainings": (min(t.trainings[0] for t in tables), max(t.trainings[1] for t in tables)) if tables else (0, 0),
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
            lines.append([f"{LABELS[first]} against {LABELS[second]}", *(one and mark(one) for one in cells)])
    return Grid.of(["", *map(column_name, columns)], lines)


def mark(one: Ordering) -> str:
    """A cell of the matrix: how much better the pair's first row is here, in percent; in brackets where the paper's
    numbers are against its argument, with a mark where they differ by less than MARGIN."""
    gain = percent(one.here.relative if one.argued else -one.here.relative).removesuffix(" %")
    words = f"{SIGNS[one.here.verdict]} {gain}{SMALL * one.small}"
    return words if one.argued else f"({words})"
