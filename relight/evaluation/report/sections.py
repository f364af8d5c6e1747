"""Computes the numbers of the sections about tables of trainings; their text is in templates/sections."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from relight.evaluation.experiments.occlusion import read_occlusion
from relight.evaluation.pictures import charts
from relight.evaluation.report.formats import (
    SIGNS,
    TextTable,
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
from relight.evaluation.report.page import better, text
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import (
    Comparison,
    Ordering,
    Verdict,
    compare_estimates,
    compare_rows,
    correct,
    orderings,
)
from relight.evaluation.scoring.labels import column_label, label
from relight.evaluation.scoring.paper import ARGUMENTS
from relight.evaluation.scoring.tables import Table

ERRORS = ("shading_rmse", "transport_rmse", "albedo_rmse", "light_rmse")
PARTS = ("shading_rmse", "shading_true_light_rmse", "transport_rmse", "light_rmse", "albedo_rmse")
AXES = {"train.figures": "number of training figures", "model.width": "width", "model.order": "order"}
LOSS_SETS = {"min": "four losses", "full": "fifteen losses", "weighted": "fifteen, transport × 4"}  # of `steps`
DAGGER = " †"  # marks printed differences that are under MARGIN
OUTCOMES = {  # of an ordering of the paper in this run
    Verdict.BETTER: "holds",
    Verdict.WORSE: "reversed",
    Verdict.EQUIVALENT: "equivalent",
    Verdict.OPEN: "open",
}
MIN_QUARTER_FIGURES = 8  # least number of test figures for a division into quarters
QUARTER_PAIRS = (("ours_full", "sfsnet_ao"), ("ours_min", "sfsnet_ao"), ("ours_full", "sfsnet"))  # compared in quarters
Numbers = dict[str, Any]
Comparisons = dict[str, dict[str, Comparison]]  # label of the pair -> column -> comparison


def experiment(results: Results, name: str) -> Numbers:
    """Computes the numbers of the section of a table of trainings, and draws its chart.

    Args:
        results: results of the run.
        name: name of the experiment.

    Returns:
        The context of templates/sections/experiment.md, or of the experiment's own template, which extends it.
        `compared` are the comparisons of its pairs, by `first against second`.
    """
    table, settings = results.table(name), results.experiments[name]
    numbers: Numbers = {"name": name, "experiment": settings, "scored": table, "grid": None, "plot": None, "plates": []}
    if not table.rows:
        return numbers
    numbers |= {"grid": score_grid(table, table.columns), "others": score_grid(table, other_columns(table))}
    numbers |= {"quarters": None, **quarters(results, name)}  # None if they cannot be compared
    if settings["axis"]:
        numbers["plot"] = results.report / f"{name}.png"
        errors = tuple(column for column in table.columns if column.endswith("rmse"))
        axis = AXES.get(settings["axis"], settings["axis"])
        charts.plot_axis(points(results, name), table, errors, axis, numbers["plot"])
    if settings["plates"]:
        numbers["plates"] = [results.report / f"{name}_{kind}.png" for kind in ("plates", "relit", "extremes")]
    compared = compare_pairs(table, settings["compare"], settings["compare_in"])
    numbers |= {"compared": compared, "comparisons": pair_grid(compared, settings["compare"]) if compared else None}
    if name in EXPERIMENTS:
        numbers |= EXPERIMENTS[name](results, name, table)
    return numbers


def write_score_table(table: Table, title: str, stem: Path) -> None:
    """Writes the table of an experiment as CSV (all columns), Markdown and LaTeX.

    Args:
        table: the estimates; without rows, as of sitting figures where nobody sits, the files say so.
        title: of the table.
        stem: path of the files without suffix.
    """
    note = text("note.md", scored=table)
    if table.rows:
        shown, others = score_grid(table, table.columns), score_grid(table, other_columns(table))
    else:
        shown, others = TextTable.of(["row", "nothing to compare"], []), None
    write_tables(stem, title, note, shown, table.statistics(), others)


def compare_pairs(table: Table, pairs: dict[str, str], columns: Iterable[str]) -> Comparisons:
    """Compares pairs of rows.

    Args:
        table: contains the rows.
        pairs: `first against second` -> what the comparison measures.
        columns: to compare.

    Returns:
        The comparisons of the pairs that the table has, by pair.
    """
    compared = {}
    for pair in pairs:
        first, _, second = pair.partition(" against ")
        compared[pair] = compare_rows(table, first, second, tuple(columns))
    return {pair: by_column for pair, by_column in compared.items() if by_column}


def pair_grid(compared: Comparisons, pairs: dict[str, str]) -> TextTable:
    """Returns a grid of comparisons of pairs, with the labels of their rows.

    Args:
        compared: `first against second` -> column -> comparison.
        pairs: `first against second` -> what the comparison measures.
    """
    labelled = {}
    for pair, by_column in compared.items():
        first, second = map(label, pair.split(" against "))
        labelled[f"{first} against {second}: {pairs[pair]}"] = by_column
    return comparison_grid(labelled)


def table1(results: Results, name: str, table: Table) -> Numbers:
    """Compares transport with the mean training figure, and Ours (min) with SfSNet-AO, which has the same losses."""
    transport = {f"{row} against mean_figure": "transport" for row in table.networks}
    losses = {"ours_min against sfsnet_ao": "with equal losses"}
    compared = compare_pairs(table, transport, ("transport_rmse",)) | compare_pairs(table, losses, ERRORS)
    return {"comparisons": pair_grid(compared, transport | losses)}


def equal_losses(results: Results, name: str, table: Table) -> Numbers:
    """Splits the lead of Ours (full) over SfSNet-AO in shading into what the losses and what the formulation gain.

    Returns:
        `parts`: `inferred`, the gain of inferring transport in place of normals and AO, and `losses`, that of fifteen
        losses over four. Each is the mean of its two comparisons, over the error of SfSNet-AO. None unless all four
        combinations are trained.
    """
    rows, parts = ("sfsnet_ao", "sfsnet_ao_full", "ours_min", "ours_full"), None
    if all(row in table.rows for row in rows):
        ao_min, ao_full, ours_min, ours_full = (table.rows[row]["shading_rmse"].mean for row in rows)
        by_formulation = (ao_min - ours_min + ao_full - ours_full) / 2
        by_losses = (ao_min - ao_full + ours_min - ours_full) / 2
        parts = {"inferred": by_formulation / ao_min, "losses": by_losses / ao_min}
    return {"parts": parts}


def sitting(results: Results, name: str, table: Table) -> Numbers:
    """Compares each network on sitting with standing test figures, and the first network with the mean figure.

    Returns:
        `standing`: number of standing test figures; `first`: the first network; `trivial`: number of errors in which it
        is better than the trivial prediction, the mean figure; `comparisons`: all of them, as a grid.
    """
    standing, first = results.table(name, usual=True), table.networks[0]
    compared = {
        f"{label(row)}, sitting against standing": compare_rows(table, row, row, ERRORS, standing)
        for row in table.networks
    }
    # Without the error of light: the mean figure has the same light under every picture.
    against_mean_figure = compare_rows(table, first, "mean_figure", ERRORS[:3])
    grid = comparison_grid({**compared, f"{label(first)} against the mean figure": against_mean_figure})
    return {
        "standing": standing.figures,
        "comparisons": grid,
        "first": first,
        "trivial": len(better(against_mean_figure)),
    }


def unusual_lights(results: Results, name: str, table: Table) -> Numbers:
    """Compares unusual with usual lights, the inferred light with the nearest training light, and training lights.

    Returns:
        `first`: the first network, of which are `fails`, column -> whether it is worse under unusual lights, `nearest`,
        the verdict on its light against the nearest training light, and `share`, its light error over that of the mean
        training light, under unusual and usual lights; `shares`: that of all networks, as a grid; `usual`: number of
        usual lights; `comparisons`: all of them, as a grid.
    """
    usual, first, rich = results.table(name, usual=True), table.networks[0], "ours_rich"
    against = compare_rows(table, first, first, ERRORS, usual)
    nearest = compare_rows(table, first, "nearest_light", ("light_rmse",))
    compared = {
        f"{label(first)}, unusual against usual lights": against,
        f"{label(first)} against the nearest training light": nearest,
    }
    if rich in table.rows:
        for scored, lights in ((table, "unusual"), (usual, "usual")):
            pair = f"{label(rich)} against {label(first)}, {lights} lights"
            compared[pair] = compare_rows(scored, rich, first, ERRORS)

    def light_error(scored: Table, row: str) -> float:
        """Returns the mean error of the light of a row under the lights of a table."""
        return scored.rows[row]["light_rmse"].mean

    shares = {
        row: [light_error(scored, row) / light_error(scored, "mean_light") for scored in (table, usual)]
        for row in table.networks
    }
    return {
        "first": first,
        "usual": usual.lights,
        "fails": {column: comparison.verdict is Verdict.WORSE for column, comparison in against.items()},
        "nearest": nearest["light_rmse"].verdict,
        "share": shares[first],
        "shares": TextTable.of(
            ["light error over that of the mean training light", "unusual lights", "usual lights"],
            [[label(row), unusual_share, usual_share] for row, (unusual_share, usual_share) in shares.items()],
            digits={"unusual lights": 2, "usual lights": 2},
        ),
        "comparisons": comparison_grid(compared),
    }


def silhouette(results: Results, name: str, table: Table) -> Numbers:
    """Compares a network that sees the mask alone with the mean figure and with one that sees the picture.

    Returns:
        `comparisons`: as a grid; `tells`: whether the mask tells of the shape, so that the network is better than the
        mean figure; `part`: how far its transport error is from that of the mean figure (0) to that of the network that
        sees the picture (1), None if that is not better than the mean figure.
    """
    columns, rows = ("transport_rmse", "shading_true_light_rmse"), ("mean_figure", "silhouette", "transport_only")
    others = ("mean_figure", "no_occlusion", "transport_only")
    compared = {
        f"{label('silhouette')} against {label(row)}": compare_rows(table, "silhouette", row, columns) for row in others
    }
    part = None
    if all(row in table.rows for row in rows) and better(
        compare_rows(table, "transport_only", "mean_figure", ("transport_rmse",))
    ):
        of_mean_figure, of_mask, of_picture = (table.rows[row]["transport_rmse"].mean for row in rows)
        part = (of_mean_figure - of_mask) / (of_mean_figure - of_picture)
    informative = "transport_rmse" in better(compare_rows(table, "silhouette", "mean_figure", columns))
    return {"comparisons": comparison_grid(compared), "tells": informative, "part": part}


def self_supervised(results: Results, name: str, table: Table) -> Numbers:
    """Tests whether fine-tuning without ground truth flattens the shading and turns the albedo into the picture.

    Returns:
        `collapsed`: row -> number of these two signs that are significant (Holm); `signs`: their values, as a grid;
        `comparisons`: of the errors before and after the fine-tuning, as a grid.
    """
    base, *tuned = table.networks
    contrast, share = (results.estimates(name, column) for column in ("shading_contrast", "albedo_share"))
    true = share["nearest_light"].mean  # of a baseline with the true albedo
    collapsed, compared = {}, {}
    for row in tuned:
        # Neither more nor less of them is better by itself, so the comparisons are of no column.
        signs_of_row = [compare_estimates("", first=values[row], second=values[base]) for values in (contrast, share)]
        by_contrast, by_share = correct(signs_of_row)
        # Each is significantly further that way than before, and than the truth, whose contrast is 1.
        is_flat = by_contrast.verdict.is_significant and by_contrast.difference.mean < 0 and by_contrast.first < 1
        is_picture = by_share.verdict.is_significant and by_share.difference.mean > 0 and by_share.first > true
        collapsed[row] = is_flat + is_picture
        compared[f"{label(row)} against {label(base)}"] = compare_rows(table, row, base, PARTS)
    rows = [[label(row), contrast[row], share[row]] for row in table.networks]
    rows.append(["truth", 1.0, true])
    signs = TextTable.of(["", "contrast of the shading", "share explained by the albedo"], rows)
    return {"signs": signs, "collapsed": collapsed, "comparisons": comparison_grid(compared)}


def along(results: Results, name: str, table: Table) -> Numbers:
    """Compares the first point of an axis with the last one, and the last two: whether more still helps.

    Returns:
        `axis`: label of the axis; `places`: the values on it; `falling`: columns that the last step makes better;
        `comparisons`: as a grid.
    """
    networks = points(results, name)
    last = len(networks) - 1
    steps = dict.fromkeys([(0, last), (last - 1, last)]) if last > 0 else {}  # one step if there are two points
    compared: Comparisons = {}
    for i, j in steps:
        (start, first), (end, second) = networks[i], networks[j]
        compared[f"{end:g} against {start:g}"] = compare_rows(table, second, first, ERRORS)
    falling = better(list(compared.values())[-1]) if compared else []
    return {
        "axis": AXES.get(results.experiments[name]["axis"]),
        "places": [place for place, _ in networks],
        "falling": falling,
        "comparisons": comparison_grid(compared),
    }


def order(results: Results, name: str, table: Table) -> Numbers:
    """Compares networks of increasing order, and their errors with what an order leaves out by itself.

    Returns:
        `floors`: for each network its shading error, that of the truth cut at its order, and the share of the latter in
        the squared error, as a grid; `comparisons`: of each order with the next lower one, as a grid.
    """
    networks, rows = points(results, name), []
    for place, row in networks:
        if cut := table.rows.get(f"cut_{place:.0f}"):
            error, floor = table.rows[row]["shading_rmse"].mean, cut["shading_rmse"].mean
            rows.append([label(row), error, floor, f"{100 * (floor / error) ** 2:.0f} %"])
    steps = {
        f"order {higher:g} against {lower:g}": compare_rows(table, higher_row, lower_row, ERRORS)
        for (lower, lower_row), (higher, higher_row) in pairwise(networks)
    }
    heads = ["", "shading RMSE", "of the cut alone", "share of the squared error"]
    return {"floors": TextTable.of(heads, rows), "comparisons": comparison_grid(steps)}


def steps(results: Results, name: str, table: Table) -> Numbers:
    """Compares the sets of losses at each length of training, and the lengths for each set.

    Returns:
        `changed`: the columns in which a set is better than another at one length, and worse at another length;
        `comparisons`: as a grid.
    """
    rows, compared, verdicts = {}, {}, defaultdict(set)
    for row in table.networks:
        rows[row.removeprefix("ours_").split("_")[0], int(results.setting(row, "train.steps"))] = row
    lengths = sorted({length for _, length in rows})
    for first, second in (("full", "min"), ("weighted", "full"), ("weighted", "min")):
        for length in lengths:
            if (first, length) in rows and (second, length) in rows:
                by_column = compare_rows(table, rows[first, length], rows[second, length], ERRORS)
                compared[f"{length:,} steps: {LOSS_SETS[first]} against {LOSS_SETS[second]}"] = by_column
                for column, comparison in by_column.items():
                    verdicts[column, first, second].add(comparison.verdict)
    for losses, words in LOSS_SETS.items():
        for shorter, longer in pairwise(length for length in lengths if (losses, length) in rows):
            by_column = compare_rows(table, rows[losses, longer], rows[losses, shorter], ERRORS)
            compared[f"{words}: {longer:,} against {shorter:,} steps"] = by_column
    both = {Verdict.BETTER, Verdict.WORSE}
    changed = {column for (column, *_), at_lengths in verdicts.items() if both <= at_lengths}
    return {"comparisons": comparison_grid(compared), "changed": [column for column in ERRORS if column in changed]}


EXPERIMENTS: dict[str, Callable[[Results, str, Table], Numbers]] = {
    "table1": table1,
    "equal_losses": equal_losses,
    "steps": steps,
    "silhouette": silhouette,
    "self_supervised": self_supervised,
    "sitting": sitting,
    "unusual_lights": unusual_lights,
    "order": order,
    "data_size": along,
    "width": along,
}


def points(results: Results, name: str) -> list[tuple[float, str]]:
    """Returns the networks of an experiment with their values on its axis.

    Args:
        results: results of the run.
        name: of the experiment, whose `axis` is a setting such as train.figures.

    Returns:
        (value, row), sorted by value. The number of training figures is at most that of the available ones.
    """
    axis = results.experiments[name]["axis"]
    networks = []
    for row in results.table(name).networks:
        place = results.setting(row, axis)
        if axis == "train.figures":
            available = len(results.split(name, row)[results.setting(row, "train.part")])
            place = min(place or available, available)  # None is for all
        networks.append((float(place), row))
    return sorted(networks, key=lambda point: point[0])


def quarters(results: Results, name: str) -> Numbers:
    """Compares the rows over quarters of the test figures, from the least to the most occluded, and writes the errors.

    Args:
        results: results of the run.
        name: name of the experiment.

    Returns:
        The errors of each row, the comparisons of methods in each quarter, and the stem of the files; empty if there
        are too few figures, or their occlusion is unknown.
    """
    file, rows = results.report / "occlusion.csv", results.scores(name)
    figures = next(iter(rows.values()))[0].figures
    if len(figures) < MIN_QUARTER_FIGURES or not file.exists():
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
    first_table = tables[heads[0]]
    columns = {
        (column_label(column), head): [cells.get(column) for cells in table.rows.values()]
        for column in first_table.present(first_table.columns)
        if column.endswith("rmse")
        for head, table in tables.items()
    }
    frame = pd.DataFrame(columns, pd.Index(map(label, first_table.rows), name="row"), dtype=object)
    shown = TextTable(frame.where(frame.notna(), None), [first_table.kind(row) for row in first_table.rows])
    leads = {
        f"{label(first)} against {label(second)}, {head}": compare_rows(table, first, second, ("shading_rmse",))
        for first, second in QUARTER_PAIRS
        for head, table in tables.items()
    }
    correct([comparison for by_column in leads.values() for comparison in by_column.values()])
    stem, title = f"{name}_occlusion", f"{results.title(name)}, by occlusion"
    write_tables(results.report / stem, title, text("notes/quarters.md"), shown)
    return {"quarters": shown, "leads": comparison_grid(leads), "quarters_file": stem}


def summary(results: Results) -> Numbers:
    """Tests which of the paper's orderings hold in this run.

    Returns:
        The context of templates/sections/summary.md. `tables`: those on the usual figures and lights; `orderings`: the
        tested ones; `verdicts`: Verdict -> their number; `small`: number of those under MARGIN in print; `trainings`:
        the least and the largest number per row; `matrix` and `listed`: the orderings as grids.
    """
    tables = [results.table(name) for name in results.readable if results.usual(name)]
    tables = [table for table in tables if table.rows]
    tested, counts = orderings(tables), [count for table in tables for count in table.trainings.values()]
    verdicts = Counter(ordering.comparison.verdict for ordering in tested)
    lines = [
        [
            f"{label(ordering.better)} before {label(ordering.worse)}",
            column_label(ordering.comparison.column),
            f"{100 * ordering.printed_difference:.1f} %{DAGGER * ordering.below_margin}{' *' * (not ordering.argued)}",
            *effect(ordering.comparison),
            *(number(value) for value in (ordering.comparison.first, ordering.comparison.second)),
            p_value(ordering.comparison.p),
            f"{SIGNS[ordering.comparison.verdict]} {OUTCOMES[ordering.comparison.verdict]}",
            bound(ordering.comparison),
        ]
        for ordering in tested
    ]
    heads = ["the paper prints", "in", "by", "here by", "interval", "first", "second", "p", "here", "within"]
    return {
        "tables": tables,
        "orderings": tested,
        "verdicts": verdicts,
        "small": sum(ordering.below_margin for ordering in tested),
        "trainings": (min(counts, default=0), max(counts, default=0)),
        "matrix": matrix(tested),
        "listed": TextTable.of(heads, lines),
    }


def matrix(tested: list[Ordering]) -> TextTable:
    """Returns a grid of verdicts and relative gains: a row per pair of ARGUMENTS, a column per quantity."""
    columns = list(dict.fromkeys(ordering.comparison.column for ordering in tested))
    lines = []
    for first, second, _ in ARGUMENTS:
        of_pair = [ordering for ordering in tested if {ordering.better, ordering.worse} == {first, second}]
        if of_pair:
            cells = {ordering.comparison.column: format_cell(ordering) for ordering in of_pair}
            lines.append([f"{label(first)} against {label(second)}", *(cells.get(column) for column in columns)])
    return TextTable.of(["", *map(column_label, columns)], lines)


def format_cell(ordering: Ordering) -> str:
    """Returns a cell of the matrix: how much better the pair's first row is in this run, in percent.

    It is in brackets if the paper's numbers contradict its argument, and has DAGGER if they differ by less than MARGIN.
    """
    gain = percent(ordering.comparison.gain if ordering.argued else -ordering.comparison.gain).removesuffix(" %")
    words = f"{SIGNS[ordering.comparison.verdict]} {gain}{DAGGER * ordering.below_margin}"
    return words if ordering.argued else f"({words})"
