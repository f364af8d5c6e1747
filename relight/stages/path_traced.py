"""Compares what networks relight with path tracing: scores by cause, and pictures."""

from pathlib import Path

from relight.config import Evaluate
from relight.stages.networks import networks_of
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
    """Scores what networks relight against path tracing, cause by cause, and draws some of it."""
    from relight.evaluation.path_traced import evaluate_traced, traced_plate

    every, first = networks_of(experiments, "path_traced", networks)
    evaluate_traced(every, packed, lights, traced, evaluate, out)
    traced_plate(first, packed, lights, traced, evaluate, plate)


if __name__ == "__main__":
    main.cli()
