"""Deals the figures into training and test parts."""

import json
from pathlib import Path

from relight.config import Split
from relight.files import whole
from relight.stages.stage import stage


@stage("split", packed="packed set (.safetensors)", out="split (.json)")
def main(split: Split, packed: Path, out: Path) -> None:
    from relight.learning.split import deal
    from relight.maps.packed import Packed

    figures = Packed(packed)
    parts = deal(figures.names, figures.subjects, split)
    with whole(out) as tmp:
        tmp.write_text(json.dumps(parts, indent=1))


if __name__ == "__main__":
    main.cli()
