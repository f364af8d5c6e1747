"""Measures and charts the self-occlusion of figures."""

from pathlib import Path

import numpy as np
import pandas as pd

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.core.progress import progress
from relight.evaluation.pictures.charts import chart
from relight.evaluation.scoring.paper import IMPLIED_AO, IMPLIED_LOST
from relight.evaluation.scoring.scores import read_table
from relight.maps import LeftOut, Maps, read_maps
from relight.sh import order_of, unoccluded

DARK = 0.5  # ambient occlusion, limit of deep shade
BINS = 20  # of ambient occlusion, over [0, 1]
UNKNOWN = "scan, unknown"  # pose or garments of figures without a record of them
SEPARATOR = "; "  # between garments in a cell of the table
HISTOGRAM = [f"ao_{i / BINS:.2f}" for i in range(BINS)]
COLUMNS = ["name", "pose", "garments", "pixels", "ao", "dark", "lost", *HISTOGRAM]


def occlusion(maps: Maps) -> dict[str, object]:
    """Returns the self-occlusion of a figure as a row of COLUMNS.

    pixels: number of pixels of the mask; ao: mean AO over them; dark: fraction with AO < DARK; lost: RMS of the vector
    norm of T - T without occlusion; HISTOGRAM: fraction in each bin of AO.
    """
    ao, transport = maps.ao[maps.mask], maps.transport[maps.mask]
    lost = transport - unoccluded(maps.normal[maps.mask], order_of(transport.shape[1]))
    counts = np.histogram(np.clip(ao, 0, 1), BINS, (0, 1))[0]
    return {
        "name": maps.info.get("name", ""),
        "pose": maps.info.get("pose", UNKNOWN),
        "garments": SEPARATOR.join(maps.info.get("garments", [UNKNOWN])),
        "pixels": int(maps.mask.sum()),
        "ao": float(ao.mean()),
        "dark": float((ao < DARK).mean()),
        "lost": float(np.sqrt((lost**2).sum(1).mean())),
        **dict(zip(HISTOGRAM, counts / counts.sum())),
    }


def measure_occlusion(maps_paths: list[Path], out: Path) -> pd.DataFrame:
    """Measures figures, except those that were left out.

    Args:
        maps_paths: maps of the figures (EXR).
        out: the table (.csv) to write, with five decimals.

    Returns:
        The table, a row of COLUMNS for each figure.
    """
    rows = []
    for path in progress(maps_paths, "occlusion"):
        try:
            rows.append(occlusion(read_maps(path)))
        except LeftOut:
            continue
    table = pd.DataFrame(rows, columns=COLUMNS)
    with atomic_write(out) as tmp:
        table.to_csv(tmp, index=False, float_format="%.5f", lineterminator="\n")
    return table


def read_occlusion(path: Path) -> pd.DataFrame:
    """Reads a table of `measure_occlusion`. Raises UserError if it is another table."""
    return read_table(path, "occlusion", COLUMNS, writer="the stage sheets")


def plot_occlusion(table: pd.DataFrame, out: Path) -> None:
    """Draws a histogram of ambient occlusion, and the transport that each figure loses to occlusion.

    Bars are means over figures, lines their central 80 %. The values that the paper implies are marked.

    Args:
        table: table of `measure_occlusion`.
        out: the chart.

    Raises:
        UserError: if there are no figures.
    """
    if table.empty:
        raise UserError(f"{out}: there are no figures to chart the occlusion of")
    shares = 100 * table[HISTOGRAM].to_numpy(float)
    middle = (np.arange(BINS) + 0.5) / BINS
    low, high = np.quantile(shares, [0.1, 0.9], axis=0)
    paper = {"color": "#ef5675", "linewidth": 1.6}
    with chart(out, width=9.2, height=3.2) as figure:
        left, right = figure.subplots(ncols=2)
        left.bar(middle, shares.mean(0), 0.9 / BINS, color="#30638e")
        left.vlines(middle, low, high, color="#1c1c1e", linewidth=1)
        left.axvline(table.ao.mean(), color="#30638e", linestyle="--", label="mean")
        left.axvline(IMPLIED_AO, linestyle=":", label="the paper's scans, implied mean", **paper)
        left.set(xlim=(0, 1), title="Ambient occlusion of pixels", ylabel="% of a figure's pixels")
        left.set_xlabel(f"AO; lines: 80 % of the figures; under {DARK:g} is deep shade")
        left.legend(loc="upper left")
        right.plot(table.ao, table.lost, "o", color="#30638e", markersize=4, alpha=0.7)
        right.plot(IMPLIED_AO, IMPLIED_LOST, "x", markersize=9, markeredgewidth=2, **paper, label="the paper, implied")
        right.set(title="Each figure", xlabel="mean AO", ylabel="rms of |T - T unoccluded|")
        right.legend()
