"""One page on which the light of the test figures turns with the mouse."""

import json
from pathlib import Path

from relight.stages.stage import stage


@stage(
    "viewer",
    split="split (.json)",
    maps="folder of maps",
    lights="lights (.npz)",
    out="page (.html)",
)
def main(name: str, split: Path, maps: Path, lights: Path, out: Path) -> None:
    from relight.lights.table import load
    from relight.viewer.build import build_gallery
    from relight.viewer.source import baked_figure

    test = load(lights).of("test")
    named = {
        f"{source.replace(':', ' ')} at {yaw:.0f}°": light
        for source, yaw, light in zip(test.source, test.yaw, test.coefficients)
    }
    figures = [baked_figure(maps / f"{figure}.exr") for figure in json.loads(split.read_text())["test"]]
    build_gallery(out, figures, {label: light[:9] for label, light in named.items()}, title=f"relight: {name}")


if __name__ == "__main__":
    main.cli()
