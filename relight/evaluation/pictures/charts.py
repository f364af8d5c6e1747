"""Draws the chart of the report: errors with intervals."""

from pathlib import Path

import matplotlib.style
from matplotlib.figure import Figure  # no pyplot: no windows, nothing global

from relight.core.files import atomic_write
from relight.evaluation.scoring.tables import Table
from relight.learning.training_name import COLORS
from relight.settings.scores import title

GREY = "#9a9a9e"  # of baselines
STYLE = ["seaborn-v0_8-paper", "seaborn-v0_8-whitegrid"]


def plot_errors(table: Table, rows_of_run: list[str], out: Path) -> None:
    """Draws means and 95 % intervals by row: a panel for each RMSE of the table, or for shading; baselines are grey.

    The table has rows, and those of networks have their colors by their places in `rows_of_run`.
    """
    shown = table.present(column for column in table.columns if column.endswith("rmse")) or ["shading_rmse"]
    rows = [row for row, cells in table.rows.items() if any(column in cells for column in shown)]
    color_of = {row: COLORS[place % len(COLORS)] for place, row in enumerate(rows_of_run)}
    with matplotlib.style.context(STYLE):
        figure = Figure(figsize=(2.6 + 2.3 * len(shown), 0.9 + 0.34 * len(rows)), layout="constrained")
        panels = figure.subplots(ncols=len(shown), sharey=True, squeeze=False)[0]
        for panel, column in zip(panels, shown):
            places, with_column = zip(*((i, row) for i, row in enumerate(rows) if column in table.rows[row]))
            estimates = [table.rows[row][column] for row in with_column]
            colors = [color_of[row] if row in table.networks else GREY for row in with_column]
            lows, highs = zip(*((estimate.low, estimate.high) for estimate in estimates))
            panel.hlines(places, lows, highs, colors=colors, linewidth=2.2)  # none for infinite ones, of one figure
            panel.scatter([estimate.mean for estimate in estimates], places, s=36, c=colors)
            panel.set(title=title(column), xlabel="lower is better", xlim=(max(0, panel.get_xlim()[0]), None))
            panel.grid(visible=False, axis="y")
        panels[0].set_yticks(range(len(rows)), map(table.label, rows), fontsize=10)
        panels[0].set_ylim(len(rows) - 0.5, -0.5)  # the first row on top
        with atomic_write(out) as tmp:
            figure.savefig(tmp, dpi=160)
