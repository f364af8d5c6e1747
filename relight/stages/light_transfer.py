"""Scores figures that swap lights."""

from pathlib import Path

from relight.stages.networks import networks_of
from relight.stages.stage import stage


@stage(
    "light_transfer",
    experiments="experiments (.json)",
    networks="folder of networks",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    out="scores (.csv)",
)
def main(experiments: Path, networks: Path, packed: Path, lights: Path, split: Path, out: Path) -> None:
    """Writes the scores of all networks of the experiment."""
    from relight.evaluation.experiments.transfer import evaluate_transfer

    by_training, _ = networks_of(experiments, "light_transfer", networks)
    evaluate_transfer(by_training, packed, lights, split, out)


if __name__ == "__main__":
    main.cli()
