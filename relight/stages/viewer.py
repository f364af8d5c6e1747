"""One page on which the light of the test figures turns with the mouse: their true maps, and those of each network."""

import json
from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage

MOST = 24  # figures of the page; more are hard to choose from
SIZE = 12_000_000  # bytes of the page; large maps leave room for fewer figures
OWN = 100_000  # of these, bytes that the page takes without a figure


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
    evaluate: Evaluate,
    experiments: Path,
    results: Path,
    packed: Path,
    split: Path,
    maps: Path,
    lights: Path,
    out: Path,
) -> None:
    """Writes the page of a run: as many test figures as fit, by their true maps and by those of each network."""
    from relight.evaluation.evaluate import inferred_maps, load
    from relight.evaluation.labels import label
    from relight.evaluation.panels import evenly_spaced
    from relight.lights import read_light_set
    from relight.viewer.build import build_gallery
    from relight.viewer.figure import QUALITIES, Figure, to_json
    from relight.viewer.source import baked_figure

    lit = read_light_set(lights)
    test = lit.of("test")
    named = {
        f"{source.replace(':', ' ')} at {yaw:.0f}°": light[:9]
        for source, yaw, light in zip(test.source, test.yaw, test.coefficients)
    }
    tables = (one["runs"] for one in json.loads(experiments.read_text()).values() if "scores" in one)
    networks = {
        label(row): load(results / "train" / f"{runs[0]}.safetensors", packed, lights, evaluate)
        for row, runs in next(tables, {}).items()
    }
    first = int((lit.split == "test").argmax())

    def sources(true: Figure) -> list[Figure]:
        """A figure with its true maps, and with those that each network infers from it in the first test light."""
        inferred = (
            Figure(true.title, inferred_maps(network, data, first, true.maps), source=name)
            for name, (network, data) in networks.items()
        )
        return [Figure(true.title, true.maps, source="truth"), *inferred]

    names = json.loads(split.read_text())["test"]
    figures = [baked_figure(maps / f"{names[i]}.exr") for i in evenly_spaced(len(names), MOST)]
    sizes = [len(to_json(figure, QUALITIES[2])) for figure in figures]
    worse = max(len(to_json(one, QUALITIES[2])) for one in sources(figures[0])) / sizes[0]
    room = int((SIZE - OWN) / (max(sizes) * worse + 1000) / (1 + len(networks)))
    shown = [figures[i] for i in evenly_spaced(len(figures), max(1, min(MOST, room)))]
    every = [one for figure in shown for one in sources(figure)]
    build_gallery(out, every, named, title=f"relight: {name}", limit=SIZE)


if __name__ == "__main__":
    main.cli()
