"""Measures the self-occlusion of figures."""

from pathlib import Path

import pandas as pd

from relight.core.files import atomic_write
from relight.core.progress import progress
from relight.evaluation.scoring.scores import read_table
from relight.maps import LeftOut, Maps, read_maps
from relight.sh import order_of, unoccluded

DARK = 0.5  # ambient occlusion, limit of deep shade
COLUMNS = ["name", "ao", "dark", "lost"]


def occlusion(maps: Maps) -> dict[str, object]:
    """Returns the self-occlusion of a figure as a row of COLUMNS.

    ao: mean AO over the mask; dark: fraction with AO < DARK; lost: RMS of the vector norm of T - T without occlusion.
    """
    ao, transport = maps.ao[maps.mask], maps.transport[maps.mask]
    lost = transport - unoccluded(maps.normal[maps.mask], order_of(transport.shape[1]))
    numbers = ao.mean(), (ao < DARK).mean(), (lost**2).sum(1).mean() ** 0.5
    return dict(zip(COLUMNS, (maps.info.get("name", ""), *map(float, numbers))))


def measure_occlusion(maps_paths: list[Path], out: Path) -> None:
    """Writes the occlusion of figures, except those that were left out.

    Args:
        maps_paths: maps of the figures (EXR).
        out: the table (.csv), a row of COLUMNS for each figure, with five decimals.
    """
    rows = []
    for path in progress(maps_paths, "occlusion"):
        try:
            rows.append(occlusion(read_maps(path)))
        except LeftOut:
            continue
    with atomic_write(out) as tmp:
        pd.DataFrame(rows, columns=COLUMNS).to_csv(tmp, index=False, float_format="%.5f", lineterminator="\n")


def read_occlusion(path: Path) -> pd.DataFrame:
    """Reads a table of `measure_occlusion`. Raises UserError if it is another table."""
    return read_table(path, "occlusion", COLUMNS, writer="the stage sheets")
