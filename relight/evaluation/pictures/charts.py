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

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.evaluation.scoring.labels import label, title
from relight.evaluation.scoring.scores import read_table
from relight.evaluation.scoring.statistics import Estimate
from relight.evaluation.scoring.tables import Table
from relight.learning.training_name import COLORS, TrainingName

STYLES = ("-", "--", ":", "-.")  # for more rows than colors
GREY = "#9a9a9e"  # of baselines
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


def _finite_interval(estimate: Estimate) -> tuple[float, float]:
    """Returns the ends of the interval of an estimate; infinite ones, of a single figure, are replaced by the mean."""
    low, high = (end if np.isfinite(end) else estimate.mean for end in (estimate.low, estimate.high))
    return low, high


def plot_errors(table: Table, rows_of_run: list[str], out: Path) -> None:
    """Draws means and 95 % intervals by row, a panel for each RMSE that the table shows; baselines are grey.

    Args:
        table: table of an experiment; it has rows.
        rows_of_run: whose places give the rows their colors.
        out: the chart.
    """
    shown = table.present(column for column in table.columns if column.endswith("rmse"))
    rows = [row for row, cells in table.rows.items() if any(column in cells for column in shown)]
    styles = row_styles(rows_of_run)
    with chart(out, width=2.6 + 2.3 * len(shown), height=0.9 + 0.34 * len(rows)) as figure:
        panels = figure.subplots(ncols=len(shown), sharey=True, squeeze=False)[0]
        for panel, column in zip(panels, shown):
            with_column = [(place, row) for place, row in enumerate(rows) if column in table.rows[row]]
            places = [place for place, _ in with_column]
            estimates = [table.rows[row][column] for _, row in with_column]
            colors = [styles[row]["color"] if row in table.networks else GREY for _, row in with_column]
            lows, highs = zip(*map(_finite_interval, estimates))
            panel.hlines(places, lows, highs, colors=colors, linewidth=2.2)
            panel.scatter([estimate.mean for estimate in estimates], places, s=36, c=colors)
            panel.set(title=title(column), xlabel="lower is better", xlim=(max(0, panel.get_xlim()[0]), None))
            panel.grid(visible=False, axis="y")
        panels[0].set_yticks(range(len(rows)), map(label, rows), fontsize=10)
        panels[0].set_ylim(len(rows) - 0.5, -0.5)  # the first row on top


class _PlainLog(LogFormatter):
    """Labels ticks of a logarithmic axis as plain numbers, where there is room."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def plot_curves(curves: list[Path], out: Path) -> None:
    """Draws training curves (row.s<seed>.csv), a panel per loss: thick on validation pairs, thin on training pictures.

    Trainings of a row have one color and line style. The total loss is left out, since trainings differ in their
    losses.

    Raises:
        UserError: if a file is not a training curve, or none has a loss.
    """
    data = {path: read_table(path, "training curve", ["step"], "the stage train") for path in curves}
    names = dict.fromkeys(name for curve in data.values() for name in curve)
    shown = [name for name in names if name not in ("step", "lr", "loss") and not name.startswith(VALIDATION)]
    styles = row_styles([TrainingName.parse(path.stem).row for path in curves])
    if not shown:
        raise UserError(f"{out}: the training curves hold no losses")
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
            panel.yaxis.set_minor_formatter(_PlainLog(minor_thresholds=(1.5, 0.5)))
            panel.xaxis.set_major_locator(MaxNLocator(5, integer=True))
            panel.set_title(name.replace("_", " "))
        for panel in panels[len(shown) :]:
            panel.set_visible(False)
        for panel in panels[max(0, len(shown) - across) : len(shown)]:
            panel.set_xlabel("step")
        handles = [matplotlib.lines.Line2D([], [], linewidth=2, **style) for style in styles.values()]
        figure.legend(handles, map(label, styles), loc="outside lower center", ncols=min(len(styles), 4), fontsize=9)


def row_styles(rows: list[str]) -> dict[str, dict[str, Any]]:
    """Returns the color and line style of each row of a run, by the order of the rows; several may be equal."""
    return {
        row: {"color": COLORS[i % len(COLORS)], "linestyle": STYLES[i // len(COLORS) % len(STYLES)]}
        for i, row in enumerate(dict.fromkeys(rows))
    }
