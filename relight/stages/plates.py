"""Draws the plates of an experiment: figures by network, one figure relit, and the best and worst figures."""

import json
from functools import partial
from pathlib import Path

from relight.stages.networks import networks_of
from relight.stages.stage import stage


@stage(
    "plates",
    experiments="experiments (.json)",
    experiment="name of one of them",
    results="folder of the results, with networks and scores",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    condition="what is scored: test, or FIGURES-LIGHTS such as sitting-test",
    out="picture of some figures (.png)",
    relit="picture of one figure under several lights (.png)",
    overview="picture of the networks' shadings under the true light (.png)",
    extremes="picture of the figures with the least and the largest error (.png)",
)
def main(
    experiments: Path,
    experiment: str,
    results: Path,
    packed: Path,
    lights: Path,
    split: Path,
    condition: str,
    out: Path,
    relit: Path,
    overview: Path,
    extremes: Path,
) -> None:
    """Draws the four pictures of an experiment, by the first training of each of its rows."""
    from relight.evaluation.pictures import panels
    from relight.evaluation.scoring.evaluate import Condition

    _, networks = networks_of(experiments, experiment, results / "train")
    files_by_row = json.loads(experiments.read_text())[experiment]["scores"]  # those of "" are the baselines'
    scores = [results / path for row, paths in files_by_row.items() if row for path in paths]
    data = packed, lights, split, Condition.parse(condition)
    panels.plates(networks, *data, lambda names: panels.evenly_spaced(len(names), panels.PLATE_FIGURES), out)
    panels.plates(networks, *data, partial(panels.extreme_places, scores), extremes)
    panels.shadings(networks, *data, overview)
    panels.relit(networks, *data, relit)


if __name__ == "__main__":
    main.cli()
