"""Measures the self-occlusion of figures."""

from pathlib import Path

import numpy as np
import pandas as pd

from relight.evaluation.scores import read_table
from relight.files import atomic_write
from relight.maps import LeftOut, Maps, read_maps
from relight.progress import progress
from relight.sh import order_of, unoccluded

DARK = 0.5  # ambient occlusion, limit of deep shade
BINS = 20  # of ambient occlusion, over [0, 1]
UNKNOWN = "scan, unknown"  # pose or garments of figures without a record of them
SEPARATOR = "; "  # between garments in a cell of the table
HISTOGRAM = [f"ao_{i / BINS:.2f}" for i in range(BINS)]
COLUMNS = ["name", "pose", "garments", "pixels", "ao", "dark", "lost", *HISTOGRAM]


def occlusion(maps: Maps) -> dict[str, object]:
    """Measures the self-occlusion of a figure.

    Args:
        maps: of the figure.

    Returns:
        A row of COLUMNS. pixels: number of pixels of the mask; ao: mean AO over them; dark: fraction with AO < DARK;
        lost: RMS of the vector norm of T - T without occlusion; HISTOGRAM: fraction in each bin of AO.
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
    """Reads a table of `measure_occlusion`.

    Raises:
        UserError: if it is another table.
    """
    return read_table(path, "occlusion", COLUMNS, "the stage sheets")


def group_occlusion(table: pd.DataFrame, by: str) -> pd.DataFrame:
    """Averages over groups of figures; each figure has the same weight.

    Args:
        table: of `measure_occlusion`.
        by: "pose"; "garment", where a figure belongs to the group of each of its garments; or "all", a single group.

    Returns:
        A row per group, darkest first: number of figures, means of ao, dark and lost, and range of ao.
    """
    table = table.assign(all="all figures", garment=table.garments.str.split(SEPARATOR)).explode("garment")
    groups = table.drop_duplicates(["name", by]).groupby(by)
    found = groups.agg(
        figures=("name", "size"),
        ao=("ao", "mean"),
        least=("ao", "min"),
        most=("ao", "max"),
        dark=("dark", "mean"),
        lost=("lost", "mean"),
    )
    return found.sort_values("ao", kind="stable")
