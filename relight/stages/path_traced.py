"""Compares what networks relight with path tracing: scores by cause, and pictures."""

import json
from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage(
    "path_traced",
    experiments="experiments (.json)",
    networks="folder of networks",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    traced="traced irradiance (.npz)",
    out="scores (.csv)",
    plate="pictures (.png)",
)
def main(
    evaluate: Evaluate,
    experiments: Path,
    networks: Path,
    packed: Path,
    lights: Path,
    traced: Path,
    out: Path,
    plate: Path,
) -> None:
    from relight.evaluation.path_traced import evaluate_traced, traced_plate

    runs = json.loads(experiments.read_text())["path_traced"]["runs"]
    every = {run: networks / f"{run}.safetensors" for row in runs.values() for run in row}
    evaluate_traced(every, packed, lights, traced, evaluate, out)
    traced_plate({row: every[trainings[0]] for row, trainings in runs.items()}, packed, lights, traced, evaluate, plate)


if __name__ == "__main__":
    main.cli()
