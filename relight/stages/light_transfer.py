"""Scores figures that swap lights, and draws some of them."""

from pathlib import Path

from relight.config import Evaluate
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
    """Scores swaps of lights by all networks of the experiment, and draws some by the first network of each row."""
    from relight.evaluation.experiments.transfer import evaluate_transfer, transfer_plate

    networks_by_run, networks_by_row = networks_of(experiments, "light_transfer", networks)
    evaluate_transfer(networks_by_run, packed, lights, split, evaluate, out)
    transfer_plate(networks_by_row, packed, lights, split, evaluate, plate)


if __name__ == "__main__":
    main.cli()
