"""The page of a run: test figures under a light that turns with the mouse, with true maps and each network's."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

MAX_FIGURES = 8  # more would be hard to choose from


def viewer(
    name: str, networks: Mapping[str, Path], packed: Path, split: Path, maps: Sequence[Path], lights: Path, out: Path
) -> None:
    """Writes the page of a run.

    Args:
        name: name of the run.
        networks: label -> network whose maps are shown beside the true ones.
        packed, split, lights: files.
        maps: of the figures (.exr).
        out: page (.html).
    """
    from relight.evaluation.pictures.panels import evenly_spaced
    from relight.evaluation.scoring.evaluate import inferred_maps, load
    from relight.lights import read_light_set
    from relight.sh import coefficient_count
    from relight.viewer.build import build_viewer
    from relight.viewer.figure import Figure
    from relight.viewer.source import baked_figure

    light_set = read_light_set(lights)
    test = light_set.of("test")
    lights_by_name = {
        f"{source.replace(':', ' ')} at {yaw:.0f}°": light[: coefficient_count(2)]  # pages have order 2
        for source, yaw, light in zip(test.source, test.yaw, test.coefficients)
    }
    first_test_light = int((light_set.split == "test").argmax())
    loaded = {label: load(path, packed, lights) for label, path in networks.items()}
    names, files = json.loads(split.read_text())["test"], {path.stem: path for path in maps}
    shown = []
    for i in evenly_spaced(len(names), MAX_FIGURES):
        baked = baked_figure(files[names[i]])
        shown.append(Figure(baked.title, baked.maps, source="truth"))
        for source, (network, data) in loaded.items():
            shown.append(Figure(baked.title, inferred_maps(network, data, first_test_light, baked.maps), source=source))
    build_viewer(out, shown, lights_by_name, title=f"relight: {name}")
