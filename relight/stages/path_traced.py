"""Compares relit pictures with path tracing: errors by cause, and plates."""

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
    """Measures relit pictures against path tracing by cause, and draws some figures."""
    from relight.evaluation.experiments.path_traced import evaluate_traced, traced_plate

    networks_by_run, networks_by_row = networks_of(experiments, "path_traced", networks)
    evaluate_traced(networks_by_run, packed, lights, traced, evaluate, out)
    traced_plate(networks_by_row, packed, lights, traced, evaluate, plate)


if __name__ == "__main__":
    main.cli()
