"""The page of a run: test figures under a light that turns with the mouse, with true maps and each network's."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

MAX_FIGURES = 24  # of the page; more would be hard to choose from
MAX_BYTES = 12_000_000  # of the page; with larger maps it has fewer figures
PAGE_BYTES = 100_000  # of a page without figures
MARKUP_BYTES = 1000  # of a figure beside its maps
TYPICAL_QUALITY = 2  # index in QUALITIES, with which figures are counted; `build_viewer` chooses the final one


def viewer(
    name: str, networks: Mapping[str, Path], packed: Path, split: Path, maps: Sequence[Path], lights: Path, out: Path
) -> None:
    """Writes the page of a run, with as many test figures as fit.

    Args:
        name: name of the run.
        networks: row -> network whose maps are shown beside the true ones.
        packed, split, lights: files.
        maps: of the figures (.exr).
        out: page (.html).
    """
    from relight.evaluation.pictures.panels import evenly_spaced
    from relight.evaluation.scoring.evaluate import inferred_maps, load
    from relight.evaluation.scoring.labels import label
    from relight.lights import read_light_set
    from relight.sh import coefficient_count
    from relight.viewer.build import build_viewer
    from relight.viewer.figure import QUALITIES, Figure, to_json
    from relight.viewer.source import baked_figure

    light_set = read_light_set(lights)
    test = light_set.of("test")
    lights_by_name = {
        f"{source.replace(':', ' ')} at {yaw:.0f}°": light[: coefficient_count(2)]  # pages have order 2
        for source, yaw, light in zip(test.source, test.yaw, test.coefficients)
    }
    loaded = {label(row): load(path, packed, lights) for row, path in networks.items()}
    first_test_light = int((light_set.split == "test").argmax())

    def versions_of(baked: Figure) -> list[Figure]:
        """Returns a figure with its true maps, and with those inferred by each network under the first test light."""
        inferred = (
            Figure(baked.title, inferred_maps(network, data, first_test_light, baked.maps), source=name)
            for name, (network, data) in loaded.items()
        )
        return [Figure(baked.title, baked.maps, source="truth"), *inferred]

    names = json.loads(split.read_text())["test"]
    files = {path.stem: path for path in maps}
    figures = [baked_figure(files[names[i]]) for i in evenly_spaced(len(names), MAX_FIGURES)]

    def coded_bytes(figure: Figure) -> int:
        """Returns the bytes of a figure in the page, at TYPICAL_QUALITY."""
        return len(to_json(figure, QUALITIES[TYPICAL_QUALITY]))

    # Inferred maps are coded for one figure only; those of the others are larger than true ones by the same factor.
    inferred_factor = max(map(coded_bytes, versions_of(figures[0]))) / coded_bytes(figures[0])
    figure_bytes = (1 + len(loaded)) * (max(map(coded_bytes, figures)) * inferred_factor + MARKUP_BYTES)
    count = int((MAX_BYTES - PAGE_BYTES) / figure_bytes)
    shown = [figures[i] for i in evenly_spaced(len(figures), max(1, min(MAX_FIGURES, count)))]
    versions = [version for figure in shown for version in versions_of(figure)]
    build_viewer(out, versions, lights_by_name, title=f"relight: {name}", limit=MAX_BYTES)
