"""Scores relit pictures against path tracing, by the causes of the error."""

from pathlib import Path

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
)
def main(experiments: Path, networks: Path, packed: Path, lights: Path, traced: Path, out: Path) -> None:
    """Writes the scores of all networks of the experiment."""
    from relight.evaluation.experiments.path_traced import evaluate_traced

    by_training, _ = networks_of(experiments, "path_traced", networks)
    evaluate_traced(by_training, packed, lights, traced, out)


if __name__ == "__main__":
    main.cli()
