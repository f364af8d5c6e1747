"""How much the figures shadow themselves: what separates a data set of folded cloth from one of bare bodies."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from relight.evaluation.scores import read_table
from relight.files import atomic_write
from relight.maps import LeftOut, Maps, read_maps
from relight.progress import progress
from relight.sh import order_of, unoccluded

DARK = 0.5
BINS = 20  # of ambient occlusion, over [0, 1]
NUMBERS = ("ao", "dark", "lost")
UNKNOWN = "scan, unknown"  # pose or garments of a figure whose info names none
SEPARATOR = "; "  # between garments in a cell of the table
HEADS = ["name", "pose", "garments", "pixels", *NUMBERS, *(f"ao_{i / BINS:.2f}" for i in range(BINS))]


@dataclass
class Occlusion:
    """Of one figure: who and in what; pixels in the mask, mean AO, share of pixels with AO < .5, the root mean square
    over pixels of |T - T_unoccluded| (vector norm of what occlusion takes from the transport), and the share of
    pixels in each of BINS bins of AO (BINS,)."""

    name: str
    pose: str
    garments: list[str]
    pixels: int
    ao: float
    dark: float
    lost: float
    histogram: np.ndarray


@dataclass
class Group:
    """Means over the figures of a group, each counting once whatever its size; least and most: their range of AO."""

    name: str
    figures: int
    ao: float
    least: float
    most: float
    dark: float
    lost: float


def occlusion(maps: Maps) -> Occlusion:
    """The statistics of one figure's maps."""
    ao, transport = maps.ao[maps.mask], maps.transport[maps.mask]
    lost = transport - unoccluded(maps.normal[maps.mask], order_of(transport.shape[1]))
    counts = np.histogram(np.clip(ao, 0, 1), BINS, (0, 1))[0]
    return Occlusion(
        maps.info.get("name", ""),
        maps.info.get("pose", UNKNOWN),
        maps.info.get("garments", [UNKNOWN]),
        int(maps.mask.sum()),
        float(ao.mean()),
        float((ao < DARK).mean()),
        float(np.sqrt((lost**2).sum(1).mean())),
        counts / counts.sum(),
    )


def occlusions(maps_paths: list[Path], out: Path) -> list[Occlusion]:
    """The statistics of each figure in `maps_paths` (EXR), and a CSV of them; left-out figures are skipped."""
    found = []
    for path in progress(maps_paths, "occlusion"):
        try:
            found.append(occlusion(read_maps(path)))
        except LeftOut:
            continue
    rows = [
        [one.name, one.pose, SEPARATOR.join(one.garments), one.pixels, one.ao, one.dark, one.lost, *one.histogram]
        for one in found
    ]
    with atomic_write(out) as tmp:
        pd.DataFrame(rows, columns=HEADS).to_csv(tmp, index=False, float_format="%.5f", lineterminator="\n")
    return found


def read_occlusions(path: Path) -> list[Occlusion]:
    """What `occlusions` wrote, to five decimals.

    Raises:
        UserError: it is another table.
    """
    table = read_table(path, "occlusion", HEADS, "relight-sheets")
    return [
        Occlusion(row[0], row[1], row[2].split(SEPARATOR), *row[3:7], np.array(row[7:], np.float64))
        for row in table[HEADS].itertuples(index=False, name=None)
    ]


def group(found: list[Occlusion], name: str) -> Group:
    """The statistics of some figures together."""
    ao = [one.ao for one in found]
    ao_mean, dark, lost = (float(np.mean([getattr(one, number) for one in found])) for number in NUMBERS)
    return Group(name, len(found), ao_mean, min(ao), max(ao), dark, lost)


def groups(found: list[Occlusion], names_of: Callable[[Occlusion], list[str]]) -> list[Group]:
    """The figures grouped by what `names_of` says of them (a figure may be in several groups), darkest group first."""
    members: dict[str, list[Occlusion]] = {}
    for one in found:
        for name in dict.fromkeys(names_of(one)):
            members.setdefault(name, []).append(one)
    return sorted((group(some, name) for name, some in members.items()), key=lambda one: (one.ao, one.name))


def by_pose(found: list[Occlusion]) -> list[Group]:
    """The figures grouped by pose, darkest first."""
    return groups(found, lambda one: [one.pose])


def by_garment(found: list[Occlusion]) -> list[Group]:
    """The figures grouped by garment, darkest first; one counts for each garment that it wears."""
    return groups(found, lambda one: one.garments)
