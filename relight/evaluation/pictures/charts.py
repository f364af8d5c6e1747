"""Draws the charts of the report: errors with intervals, and training curves. SVG or PNG, by the suffix."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.lines
import numpy as np
from matplotlib.figure import Figure  # no pyplot: no windows, nothing global
from matplotlib.ticker import LogFormatter, MaxNLocator

from relight.errors import UserError
from relight.evaluation.scoring.labels import LABELS, label, title
from relight.evaluation.scoring.scores import read_table
from relight.evaluation.scoring.statistics import Estimate
from relight.evaluation.scoring.tables import Table, sign
from relight.files import atomic_write
from relight.training_name import TrainingName

COLORS = ("#7a5195", "#ef5675", "#ffa600", "#00798c", "#30638e", "#6a994e", "#8d99ae", "#bc6c25")
STYLES = ("-", "--", ":", "-.")  # for more rows than colors
NETWORK = "#00798c"  # of the networks along an axis
GREY = "#9a9a9e"  # of baselines
DASHES = ("--", ":", "-.", (0, (1, 4)), (0, (6, 4)), (0, (4, 1, 1, 1, 1, 1)), (0, (14, 2)))  # of baselines
VALIDATION = "validation/"  # prefix of the names of losses on the validation pairs
STYLE = {
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.labelsize": 8,
    "axes.labelcolor": "#777777",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#888888",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e3",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.solid_capstyle": "butt",
    "svg.hashsalt": "relight",  # reproducible ids
    "svg.fonttype": "path",
    **{f"{axis}tick.{which}.size": 0 for axis in "xy" for which in ("major", "minor")},
    **{f"{axis}tick.labelsize": 8 for axis in "xy"},
}


@contextmanager
def chart(out: Path, width: float, height: float) -> Iterator[Figure]:
    """Yields an empty figure in the report's style, then saves it, with the same bytes for the same content.

    Args:
        out: SVG or PNG, by the suffix.
        width, height: in inches.
    """
    with matplotlib.rc_context(STYLE):  # type: ignore[arg-type]  # its hints list every key
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        with atomic_write(out) as tmp:
            # Without the date, which would change the bytes.
            options = {"metadata": {"Date": None}} if out.suffix == ".svg" else {"dpi": 160}
            figure.savefig(tmp, **options)


def finite_interval(estimate: Estimate) -> tuple[float, float]:
    """Returns the ends of the interval of an estimate; infinite ones, of a single figure, are replaced by the mean."""
    low, high = (end if np.isfinite(end) else estimate.mean for end in (estimate.low, estimate.high))
    return low, high


def plot_errors(table: Table, columns: tuple[str, ...], out: Path) -> None:
    """Draws means and 95 % intervals by row; baselines are grey.

    Args:
        table: table of an experiment.
        columns: one panel for each that the table has.
        out: the chart.
    """
    shown = table.present(columns)
    rows = [row for row, cells in table.rows.items() if any(column in cells for column in shown)]
    if not rows:
        with chart(out, width=4, height=1) as figure:
            figure.text(0.5, 0.5, "no scores", ha="center", va="center")
        return
    with chart(out, width=2.6 + 2.3 * len(shown), height=0.9 + 0.34 * len(rows)) as figure:
        panels = figure.subplots(ncols=len(shown), sharey=True, squeeze=False)[0]
        for panel, column in zip(panels, shown):
            with_column = [(place, row) for place, row in enumerate(rows) if column in table.rows[row]]
            places = [place for place, _ in with_column]
            estimates = [table.rows[row][column] for _, row in with_column]
            colors = [color_of(row) if row in table.networks else GREY for _, row in with_column]
            lows, highs = zip(*map(finite_interval, estimates))
            panel.hlines(places, lows, highs, colors=colors, linewidth=2.2)
            panel.scatter([estimate.mean for estimate in estimates], places, s=36, c=colors)
            panel.set(title=title(column), xlabel=f"{'lower' if sign(column) > 0 else 'higher'} is better")
            panel.grid(visible=False, axis="y")
        panels[0].set_yticks(range(len(rows)), map(label, rows), fontsize=10)
        panels[0].set_ylim(len(rows) - 0.5, -0.5)  # the first row on top


class PlainLog(LogFormatter):
    """Labels ticks of a logarithmic axis as plain numbers, where there is room."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def plot_curves(curves: list[Path], out: Path) -> None:
    """Draws training curves, one panel per loss: thick on the validation pairs, thin on the training pictures.

    Trainings of a row have one color and line style. The total loss is left out, since trainings differ in their
    losses.

    Args:
        curves: CSV files of `learning.train`, named row.s<seed>.csv.
        out: the chart.

    Raises:
        UserError: if a file is not a training curve, or none has a loss.
    """
    data = {path: read_table(path, "training curve", ["step"], "the stage train") for path in curves}
    names = dict.fromkeys(name for curve in data.values() for name in curve)
    shown = [name for name in names if name not in ("step", "lr", "loss") and not name.startswith(VALIDATION)]
    rows = list(dict.fromkeys(TrainingName.parse(path.stem).row for path in curves))
    if not shown:
        raise UserError(f"{out}: the training curves hold no losses")
    styles: dict[str, dict[str, Any]] = {
        row: {"color": COLORS[i % len(COLORS)], "linestyle": STYLES[i // len(COLORS) % len(STYLES)]}
        for i, row in enumerate(rows)
    }
    across = min(4, len(shown))  # panels side by side
    down = math.ceil(len(shown) / across)
    with chart(out, width=3.1 * across, height=0.7 + 2.1 * down) as figure:
        panels = figure.subplots(down, across, squeeze=False).ravel()
        for panel, name in zip(panels, shown):
            for path, curve in data.items():
                style = styles[TrainingName.parse(path.stem).row]
                if name in curve:
                    panel.plot(curve["step"], curve[name], linewidth=0.8, alpha=0.6, **style)
                if f"{VALIDATION}{name}" in curve:
                    panel.plot(curve["step"], curve[f"{VALIDATION}{name}"], linewidth=1.8, **style)
            panel.set_yscale("log")
            panel.yaxis.set_major_formatter("{x:g}")
            panel.yaxis.set_minor_formatter(PlainLog(minor_thresholds=(1.5, 0.5)))
            panel.xaxis.set_major_locator(MaxNLocator(5, integer=True))
            panel.set_title(name.replace("_", " "))
        for panel in panels[len(shown) :]:
            panel.set_visible(False)
        for panel in panels[max(0, len(shown) - across) : len(shown)]:
            panel.set_xlabel("step")
        handles = [matplotlib.lines.Line2D([], [], linewidth=2, **styles[row]) for row in rows]
        figure.legend(handles, map(label, rows), loc="outside lower center", ncols=min(len(rows), 4), fontsize=9)


def plot_axis(points: list[tuple[float, str]], table: Table, columns: tuple[str, ...], axis: str, out: Path) -> None:
    """Draws errors and 95 % intervals over a setting, with baselines as grey lines.

    The axis is logarithmic if its values span a factor of four or more.

    Args:
        points: (value on the axis, row of the table).
        table: table of the experiment.
        columns: one panel for each that a row has.
        axis: label.
        out: the chart.
    """
    columns = tuple(column for column in columns if any(column in table.rows[row] for _, row in points))
    with chart(out, width=2.9 * len(columns), height=3.6) as figure:
        shown: dict[str, matplotlib.lines.Line2D] = {}  # label of a baseline -> its line
        for panel, column in zip(figure.subplots(ncols=len(columns), squeeze=False)[0], columns):
            with_column = [(place, row) for place, row in points if column in table.rows[row]]
            places = [place for place, _ in with_column]
            estimates = [table.rows[row][column] for _, row in with_column]
            lows, highs = zip(*map(finite_interval, estimates))
            panel.plot(places, [estimate.mean for estimate in estimates], "o-", color=NETWORK, linewidth=1.6)
            panel.vlines(places, lows, highs, colors=NETWORK, linewidth=2.2)
            for row, dashes in zip(table.baselines, DASHES):
                if column in table.rows[row]:
                    mean = table.rows[row][column].mean
                    shown[label(row)] = panel.axhline(mean, color=GREY, linewidth=1.2, linestyle=dashes)
            if max(places) >= 4 * min(places):
                panel.set_xscale("log", base=2)
            panel.set_xticks(places, [f"{place:g}" for place in places])
            panel.minorticks_off()
            panel.set(title=title(column), xlabel=axis)
            panel.set_ylim(bottom=0)
        figure.legend(shown.values(), shown, loc="outside lower center", ncols=3, fontsize=9)


def color_of(row: str) -> str:
    """Returns the color of a row, the same in every chart of errors, which name their rows."""
    known = list(LABELS)
    return COLORS[(known.index(row) if row in known else sum(row.encode())) % len(COLORS)]
