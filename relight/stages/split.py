"""Splits the figures, each with all its views, into training, validation and test, with sitting figures apart."""

import json
from pathlib import Path

from relight.config import Split
from relight.files import atomic_write
from relight.stages.stage import stage


@stage("split", packed="packed set (.safetensors)", record="what the figures are (.json)", out="split (.json)")
def main(split: Split, packed: Path, record: Path, out: Path) -> None:
    """Writes the names of the figures by part of the split: train, validation, test and so on."""
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
    parts = split_figures(list(subjects), list(subjects.values()), split, sitting)
    with atomic_write(out) as tmp:
        tmp.write_text(json.dumps(parts, indent=1))


if __name__ == "__main__":
    main.cli()
