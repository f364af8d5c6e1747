"""Charts of the report: errors with their intervals, training curves, occlusion. SVG or PNG, by the file's suffix."""

from pathlib import Path

import matplotlib
import matplotlib.lines
import numpy as np
from matplotlib.ticker import LogFormatter, MaxNLocator

from relight.evaluation.occlusion import BINS, DARK, Occlusion
from relight.evaluation.paper import IMPLIED_AO, IMPLIED_LOST
from relight.evaluation.scores import read_table
from relight.evaluation.tables import LABELS, QUANTITY, READING, Row, Table, sign, split_column
from relight.files import UserError, atomic_write
from relight.run_name import RunName

COLORS = ("#7a5195", "#ef5675", "#ffa600", "#00798c", "#30638e", "#6a994e", "#8d99ae", "#bc6c25")
DASHES = ("--", ":", "-.", (0, (1, 4)), (0, (6, 4)), (0, (4, 1, 1, 1, 1, 1)), (0, (14, 2)))  # of baselines
VALIDATION = "validation/"  # before the name of a loss in a training curve
STYLE = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#888888",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e3",
    "svg.hashsalt": "relight",  # the same ids in every run
    "svg.fonttype": "path",
}


def plot_errors(table: Table, columns: tuple[str, ...], out: Path) -> None:
    """One panel per column of `columns` that the table has: each row's mean and 95 % interval; baselines in grey."""
    shown = [c for c in columns if any(c in row.cells for row in table.rows)]
    names = [row for row in table.rows if any(c in row.cells for c in shown)]
    with matplotlib.rc_context(STYLE):
        figure = new_figure(2.6 + 2.3 * len(shown), 0.9 + 0.34 * len(names))
        for i, (panel, column) in enumerate(zip(figure.subplots(1, len(shown), sharey=True, squeeze=False)[0], shown)):
            for place, row in enumerate(names):
                own = "#9a9a9e" if row.baseline else color_of(row.name)
                if column not in row.cells:
                    continue
                one = row.cells[column].estimate
                low, high = (v if np.isfinite(v) else one.mean for v in (one.low, one.high))
                panel.plot([low, high], [place, place], color=own, linewidth=2.2, solid_capstyle="butt")
                panel.plot(one.mean, place, "o", color=own, markersize=6)
            quantity, reading = split_column(column)
            better = "lower" if sign(column) > 0 else "higher"
            panel.set_title(f"{QUANTITY[quantity]} {READING[reading]}", fontsize=10, fontweight="bold")
            panel.set_xlabel(f"{better} is better", fontsize=8, color="#777777")
            panel.tick_params(length=0)
            panel.grid(False, axis="y")
            if i == 0:
                panel.set_yticks(range(len(names)), [row.label for row in names])
                panel.set_ylim(len(names) - 0.5, -0.5)
        save_figure(figure, out)


class PlainLog(LogFormatter):
    """Labels those ticks of a logarithmic axis that have room, as plain numbers."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def plot_curves(curves: list[Path], out: Path) -> None:
    """Draws training curves, a panel per loss: thick on the fixed pairs of the test, thin on the training pictures.

    Trainings of one row share a colour. Totals are left out: different losses have different sums.

    Args:
        curves: CSV files of `learning.train`, called row.s<seed>.csv.
        out: the chart.

    Raises:
        UserError: if a file is no training curve.
    """
    data = {path: read_table(path, "training curve", ["step"], "relight-train") for path in curves}
    names = dict.fromkeys(name for curve in data.values() for name in curve)
    shown = [name for name in names if name not in ("step", "lr", "loss") and not name.startswith(VALIDATION)]
    rows = list(dict.fromkeys(RunName.parse(path.stem).run for path in curves))
    across = min(4, len(shown))
    down = -(-len(shown) // across)
    with matplotlib.rc_context(STYLE):
        figure = new_figure(3.1 * across, 0.7 + 2.1 * down)
        panels = figure.subplots(down, across, squeeze=False).ravel()
        for panel, name in zip(panels, shown):
            for path, curve in data.items():
                style = {"color": color_of(RunName.parse(path.stem).run)}
                if name in curve:
                    panel.plot(curve["step"], curve[name], linewidth=0.8, alpha=0.6, **style)
                if f"{VALIDATION}{name}" in curve:
                    panel.plot(curve["step"], curve[f"{VALIDATION}{name}"], linewidth=1.8, **style)
            panel.set_yscale("log")
            panel.yaxis.set_major_formatter("{x:g}")
            panel.yaxis.set_minor_formatter(PlainLog(minor_thresholds=(1.5, 0.5)))
            panel.xaxis.set_major_locator(MaxNLocator(5, integer=True))
            panel.tick_params(which="both", labelsize=7, length=0)
            panel.set_title(name.replace("_", " "), fontsize=10, fontweight="bold")
        for panel in panels[len(shown) :]:
            panel.set_visible(False)
        for panel in panels[max(0, len(shown) - across) : len(shown)]:
            panel.set_xlabel("step", fontsize=8, color="#777777")
        handles = [matplotlib.lines.Line2D([], [], color=color_of(row), linewidth=2) for row in rows]
        labels = [LABELS.get(row, row) for row in rows]
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(rows), 4), frameon=False, fontsize=9)
        save_figure(figure, out)


def plot_axis(
    points: list[tuple[float, Row]], baselines: list[Row], columns: tuple[str, ...], label: str, out: Path
) -> None:
    """One panel per column: the mean and 95 % interval of each row over its place on a setting.

    Places that span a factor of four or more are on a log scale. Baselines that have the column are grey levels.
    """
    with matplotlib.rc_context(STYLE):
        figure = new_figure(2.9 * len(columns), 3.6)
        shown: dict[str, matplotlib.lines.Line2D] = {}
        for panel, column in zip(figure.subplots(1, len(columns), squeeze=False)[0], columns):
            own = [(place, row.cells[column].estimate) for place, row in points if column in row.cells]
            panel.plot([x for x, _ in own], [one.mean for _, one in own], "o-", color=COLORS[3], linewidth=1.6)
            for place, one in own:
                low, high = (v if np.isfinite(v) else one.mean for v in (one.low, one.high))
                panel.plot([place, place], [low, high], color=COLORS[3], linewidth=2.2, solid_capstyle="butt")
            for row, dashes in zip(baselines, DASHES):
                if column in row.cells:
                    style = {"color": "#9a9a9e", "linewidth": 1.2, "linestyle": dashes}
                    shown[row.label] = panel.axhline(row.cells[column].estimate.mean, **style)
            places = sorted({place for place, _ in own})
            if places[-1] >= 4 * places[0]:
                panel.set_xscale("log", base=2)
            panel.set_xticks(places, [f"{place:g}" for place in places])
            panel.minorticks_off()
            panel.set_ylim(0)
            quantity, reading = split_column(column)
            panel.set_title(f"{QUANTITY[quantity]} {READING[reading]}", fontsize=10, fontweight="bold")
            panel.set_xlabel(label, fontsize=8, color="#777777")
            panel.tick_params(length=0, labelsize=8)
        figure.legend(shown.values(), shown, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
        save_figure(figure, out)


def plot_occlusion(found: list[Occlusion], out: Path) -> None:
    """Ambient occlusion over pixels (mean over figures, and the middle 80 % of them), and what occlusion takes from the
    transport of each figure; the values that the paper implies beside. UserError without figures."""
    if not found:
        raise UserError(f"{out}: there are no figures to chart the occlusion of")
    shares = 100 * np.array([one.histogram for one in found])
    middle = (np.arange(BINS) + 0.5) / BINS
    low, high = np.quantile(shares, [0.1, 0.9], axis=0)
    paper = {"color": "#ef5675", "linewidth": 1.6}
    with matplotlib.rc_context(STYLE):
        figure = new_figure(9.2, 3.2)
        left, right = figure.subplots(1, 2)
        left.bar(middle, shares.mean(0), 0.9 / BINS, color="#30638e")
        left.vlines(middle, low, high, color="#1c1c1e", linewidth=1)
        left.axvline(np.mean([one.ao for one in found]), color="#30638e", linestyle="--", label="mean")
        left.axvline(IMPLIED_AO, linestyle=":", label="the paper's scans, implied mean", **paper)
        left.set_xlim(0, 1)
        left.set_title("Ambient occlusion of pixels", fontsize=10, fontweight="bold")
        left.set_xlabel(f"AO; lines: 80 % of the figures; under {DARK:g} is deep shade", fontsize=8, color="#777777")
        left.set_ylabel("% of a figure's pixels", fontsize=8, color="#777777")
        left.legend(frameon=False, fontsize=8, loc="upper left")
        right.plot(
            [one.ao for one in found], [one.lost for one in found], "o", color="#30638e", markersize=4, alpha=0.7
        )
        right.plot(IMPLIED_AO, IMPLIED_LOST, "x", markersize=9, markeredgewidth=2, **paper, label="the paper, implied")
        right.set_title("Each figure", fontsize=10, fontweight="bold")
        right.set_xlabel("mean AO", fontsize=8, color="#777777")
        right.set_ylabel("rms of |T - T unoccluded|", fontsize=8, color="#777777")
        right.legend(frameon=False, fontsize=8)
        for panel in (left, right):
            panel.tick_params(labelsize=8, length=0)
        save_figure(figure, out)


def color_of(row: str) -> str:
    """The colour of a row, the same in every chart."""
    known = list(LABELS)
    return COLORS[(known.index(row) if row in known else sum(row.encode())) % len(COLORS)]


def new_figure(width: float, height: float):
    """An empty figure, sizes in inches."""
    from matplotlib.figure import Figure  # no pyplot: no windows, nothing global

    return Figure(figsize=(width, height), layout="constrained")


def save_figure(figure, out: Path) -> None:
    """Writes a figure as SVG or PNG, by the suffix, the same bytes for the same figure."""
    with atomic_write(out) as tmp:
        dated = {"metadata": {"Date": None}} if out.suffix == ".svg" else {"dpi": 160}  # a date would change the bytes
        figure.savefig(tmp, **dated)
