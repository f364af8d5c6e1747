"""The jobs that make a data set of all figures: the packed set, and its split."""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.settings import Split


def pack(maps: Sequence[Path], least: float, out: Path, record: Path) -> None:
    """Writes the maps of all figures as one packed set, and the record of what was left out (.json).

    Args:
        maps: of all figures, outfits and views (.exr).
        least: least share of usable figures.
        out: the packed set (.safetensors).
        record: `figures`, the record of each figure, and `left_out`, the reasons by name.

    Raises:
        UserError: if too few figures are usable.
    """
    from relight.maps import pack_maps, read_info

    infos = {path.stem: read_info(path) for path in maps}
    # Further views and outfits, which have another name than their figure, do not count as figures.
    figures = {name: info for name, info in infos.items() if info.get("figure", name) == name}
    reasons = {name: info["left_out"] for name, info in figures.items() if "left_out" in info}
    usable = len(figures) - len(reasons)
    needed = max(2, math.ceil(least * len(figures)))  # one to train on and one to test on, at least
    if usable < needed:
        first = "".join(f"; {name}: {reason}" for name, reason in list(reasons.items())[:3])
        raise UserError(
            f"only {usable} of {len(figures)} figures are usable, and at least {needed} are needed "
            f"(split.least={least}){first}"
        )
    for name, reason in reasons.items():
        print(f"left out: {name}: {reason}", file=sys.stderr)
    pack_maps(list(maps), out)
    with atomic_write(record) as tmp:
        tmp.write_text(json.dumps({"figures": figures, "left_out": reasons}, indent=1))


def split(settings: Split, packed: Path, record: Path, out: Path) -> None:
    """Writes the names of the figures by part of the split: train, validation, test and so on (.json).

    Args:
        settings: of the split.
        packed, record: as from `pack`.
        out: the split (.json).
    """
    from relight.learning.split import is_seated, split_figures
    from relight.maps import PackedMaps

    packed_maps = PackedMaps(packed)
    # Of frontal views in the first outfit, whose maps have the name of the figure.
    subjects = {
        name: subject
        for name, subject, figure in zip(packed_maps.names, packed_maps.subjects, packed_maps.figures)
        if name == figure
    }
    sitting = {name for name, info in json.loads(record.read_text())["figures"].items() if is_seated(info)}
    parts = split_figures(list(subjects), list(subjects.values()), settings, sitting)
    with atomic_write(out) as tmp:
        tmp.write_text(json.dumps(parts, indent=1))
