"""Writes a page with the test figures under a light that rotates with the mouse: true maps, and each network's."""

import json
from pathlib import Path

from relight.stages.stage import stage

MAX_FIGURES = 24  # of the page; more would be hard to choose from
MAX_BYTES = 12_000_000  # of the page; with larger maps it has fewer figures
PAGE_BYTES = 100_000  # of a page without figures
MARKUP_BYTES = 1000  # of a figure beside its maps
TYPICAL_QUALITY = 2  # index in QUALITIES, with which figures are counted; `build_viewer` chooses the final one


@stage(
    "viewer",
    experiments="experiments (.json)",
    results="folder of the results, with networks",
    packed="packed set (.safetensors)",
    split="split (.json)",
    maps="folder of maps",
    lights="lights (.npz)",
    out="page (.html)",
)
def main(
    name: str,
    experiments: Path,
    results: Path,
    packed: Path,
    split: Path,
    maps: Path,
    lights: Path,
    out: Path,
) -> None:
    """Writes the page of a run, with as many test figures as fit."""
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
    tables = (settings for settings in json.loads(experiments.read_text()).values() if "scores" in settings)
    first_table: dict = next(tables, {"trainings": {}})
    networks = {
        label(row): load(results / "train" / f"{trainings[0]}.safetensors", packed, lights)
        for row, trainings in first_table["trainings"].items()
    }
    first_test_light = int((light_set.split == "test").argmax())

    def versions_of(baked: Figure) -> list[Figure]:
        """Returns a figure with its true maps, and with those inferred by each network under the first test light."""
        inferred = (
            Figure(baked.title, inferred_maps(network, data, first_test_light, baked.maps), source=name)
            for name, (network, data) in networks.items()
        )
        return [Figure(baked.title, baked.maps, source="truth"), *inferred]

    names = json.loads(split.read_text())["test"]
    figures = [baked_figure(maps / f"{names[i]}.exr") for i in evenly_spaced(len(names), MAX_FIGURES)]

    def coded_bytes(figure: Figure) -> int:
        """Returns the bytes of a figure in the page, at TYPICAL_QUALITY."""
        return len(to_json(figure, QUALITIES[TYPICAL_QUALITY]))

    # Inferred maps are coded for one figure only; those of the others are larger than true ones by the same factor.
    inferred_factor = max(map(coded_bytes, versions_of(figures[0]))) / coded_bytes(figures[0])
    figure_bytes = (1 + len(networks)) * (max(map(coded_bytes, figures)) * inferred_factor + MARKUP_BYTES)
    count = int((MAX_BYTES - PAGE_BYTES) / figure_bytes)
    shown = [figures[i] for i in evenly_spaced(len(figures), max(1, min(MAX_FIGURES, count)))]
    versions = [version for figure in shown for version in versions_of(figure)]
    build_viewer(out, versions, lights_by_name, title=f"relight: {name}", limit=MAX_BYTES)


if __name__ == "__main__":
    main.cli()
