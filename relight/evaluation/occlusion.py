"""How much the figures shadow themselves: what separates a data set of folded cloth from one of bare bodies."""

import csv
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from relight.files import whole
from relight.maps.exr import LeftOut, read_maps
from relight.maps.maps import Maps
from relight.progress import progress
from relight.sh.basis import order_of
from relight.sh.irradiance import unoccluded

DARK = 0.5


@dataclass
class Occlusion:
    """Of one figure: pixels in the mask, mean AO, share of pixels with AO < .5, and the root mean square over pixels
    of |T - T_unoccluded|, the vector norm of what occlusion takes from the transport."""

    name: str
    pixels: int
    ao: float
    dark: float
    lost: float


def occlusion(maps: Maps) -> Occlusion:
    """The statistics of one figure's maps."""
    ao, transport = maps.ao[maps.mask], maps.transport[maps.mask]
    lost = transport - unoccluded(maps.normal[maps.mask], order_of(transport.shape[1]))
    return Occlusion(
        maps.info.get("name", ""),
        int(maps.mask.sum()),
        float(ao.mean()),
        float((ao < DARK).mean()),
        float(np.sqrt((lost**2).sum(1).mean())),
    )


def occlusions(maps_paths: list[Path], out: Path) -> list[Occlusion]:
    """The statistics of each figure in `maps_paths` (EXR), and a CSV of them; left-out figures are skipped."""
    found = []
    for path in progress(maps_paths, "occlusion"):
        try:
            found.append(occlusion(read_maps(path)))
        except LeftOut:
            continue
    with whole(out) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(Occlusion)])
        writer.writerows([f"{v:.5f}" if isinstance(v, float) else v for v in astuple(one)] for one in found)
    return found
