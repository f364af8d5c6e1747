"""Packs the maps of all figures into one file for training, and lists the figures that were left out."""

import json
import math
import sys
from pathlib import Path

from relight.config import Split
from relight.errors import UserError
from relight.files import atomic_write
from relight.stages.stage import stage


@stage(
    "pack",
    names="maps of all figures and views, one name per line (.txt)",
    maps="folder of maps",
    out="packed set (.safetensors)",
    record="what was left out (.json)",
)
def main(split: Split, names: Path, maps: Path, out: Path, record: Path) -> None:
    """Writes the maps of all figures as one packed set.

    Raises:
        UserError: if too few figures are usable.
    """
    from relight.maps import pack_maps, read_info

    all_names = names.read_text().split()
    infos = {name: read_info(maps / f"{name}.exr") for name in all_names}
    # Further views and outfits, which have another name than their figure, do not count as figures.
    figures = {name: info for name, info in infos.items() if info.get("figure", name) == name}
    reasons = {name: info["left_out"] for name, info in figures.items() if "left_out" in info}
    usable = len(figures) - len(reasons)
    needed = max(2, math.ceil(split.least * len(figures)))  # one to train on and one to test on, at least
    if usable < needed:
        first = "".join(f"; {name}: {reason}" for name, reason in list(reasons.items())[:3])
        raise UserError(
            f"only {usable} of {len(figures)} figures are usable, and at least {needed} are needed "
            f"(split.least={split.least}){first}"
        )
    for name, reason in reasons.items():
        print(f"left out: {name}: {reason}", file=sys.stderr)
    pack_maps([maps / f"{name}.exr" for name in all_names], out)
    with atomic_write(record) as tmp:
        tmp.write_text(json.dumps({"figures": figures, "left_out": reasons}, indent=1))


if __name__ == "__main__":
    main.cli()
