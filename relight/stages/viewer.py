"""One page on which the light of the test figures turns with the mouse."""

import json
from pathlib import Path

from relight.stages.stage import stage

MOST = 24  # figures of the page; more are hard to choose from
SIZE = 12_000_000  # bytes of the page; large maps leave room for fewer figures
OWN = 100_000  # of these, bytes that the page takes without a figure


@stage(
    "viewer",
    split="split (.json)",
    maps="folder of maps",
    lights="lights (.npz)",
    out="page (.html)",
)
def main(name: str, split: Path, maps: Path, lights: Path, out: Path) -> None:
    from relight.evaluation.panels import spaced
    from relight.lights import read_light_set
    from relight.viewer.build import build_gallery
    from relight.viewer.figure import QUALITIES, to_json
    from relight.viewer.source import baked_figure

    test = read_light_set(lights).of("test")
    named = {
        f"{source.replace(':', ' ')} at {yaw:.0f}°": light
        for source, yaw, light in zip(test.source, test.yaw, test.coefficients)
    }
    names = json.loads(split.read_text())["test"]
    figures = [baked_figure(maps / f"{names[i]}.exr") for i in spaced(len(names), MOST)]
    each = max(len(to_json(figure, QUALITIES[2])) for figure in figures)
    room = max(1, min(MOST, (SIZE - OWN) // (each + 1000)))
    chosen = [figures[i] for i in spaced(len(figures), room)]
    build_gallery(
        out, chosen, {label: light[:9] for label, light in named.items()}, title=f"relight: {name}", limit=SIZE
    )


if __name__ == "__main__":
    main.cli()
