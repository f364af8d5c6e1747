"""The qualitative figure of an experiment: some figures as each network sees them."""

import json
from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage(
    "plates",
    experiments="experiments (.json)",
    experiment="name of one of them",
    networks="folder of networks",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    out="picture (.png)",
)
def main(
    evaluate: Evaluate,
    experiments: Path,
    experiment: Path,
    networks: Path,
    packed: Path,
    lights: Path,
    split: Path,
    out: Path,
) -> None:
    from relight.evaluation.plates import plates

    runs = json.loads(experiments.read_text())[experiment.name]["runs"]
    first = {row: networks / f"{trainings[0]}.safetensors" for row, trainings in runs.items()}
    plates(first, packed, lights, split, evaluate, out)


if __name__ == "__main__":
    main.cli()
