"""Figures that swap lights: scores of all networks, and pictures of some swaps."""

import json
from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage(
    "light_transfer",
    experiments="experiments (.json)",
    networks="folder of networks",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    out="scores (.csv)",
    plate="pictures of some swaps (.png)",
)
def main(
    evaluate: Evaluate,
    experiments: Path,
    networks: Path,
    packed: Path,
    lights: Path,
    split: Path,
    out: Path,
    plate: Path,
) -> None:
    from relight.evaluation.transfer import evaluate_transfer, transfer_plate

    runs = json.loads(experiments.read_text())["light_transfer"]["runs"]
    every = {run: networks / f"{run}.safetensors" for row in runs.values() for run in row}
    evaluate_transfer(every, packed, lights, split, evaluate, out)
    transfer_plate(
        {row: every[trainings[0]] for row, trainings in runs.items()}, packed, lights, split, evaluate, plate
    )


if __name__ == "__main__":
    main.cli()
