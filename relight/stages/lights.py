"""Makes the light set from panoramas: projection, selection, split."""

import json
from pathlib import Path

from relight.config import Lights, Panoramas
from relight.files import atomic_write
from relight.stages.stage import stage


@stage("lights", out="lights (.npz, and a .csv of the same beside it)", record="what each step dropped (.json)")
def main(panoramas: Panoramas, lights: Lights, order: int, out: Path, record: Path) -> None:
    """Writes the light set, and the record of the lights that each step dropped.

    Args:
        panoramas: which panoramas are generated or read.
        lights: how lights are selected.
        order: of the spherical harmonics.
        out, record: files.
    """
    from relight.lights import build_light_set, write_light_set

    light_set, dropped = build_light_set(panoramas, lights, order)
    with atomic_write(record) as tmp:
        tmp.write_text(json.dumps(dropped, indent=1))
    write_light_set(light_set, out)


if __name__ == "__main__":
    main.cli()
