"""Deals the figures into training and test parts, and sets those apart that sit."""

import json
from pathlib import Path

from relight.config import Split
from relight.files import whole
from relight.stages.stage import stage


@stage("split", packed="packed set (.safetensors)", record="what the figures are (.json)", out="split (.json)")
def main(split: Split, packed: Path, record: Path, out: Path) -> None:
    from relight.learning.split import deal, sits
    from relight.maps.packed import Packed

    figures = Packed(packed)
    sitting = {name for name, info in json.loads(record.read_text())["figures"].items() if sits(info)}
    parts = deal(figures.names, figures.subjects, split, sitting)
    with whole(out) as tmp:
        tmp.write_text(json.dumps(parts, indent=1))


if __name__ == "__main__":
    main.cli()
