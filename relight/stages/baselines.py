"""Scores the baselines on the same pairs as the networks."""

from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage(
    "baselines",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    out="scores (.csv)",
)
def main(evaluate: Evaluate, color: str, order: int, packed: Path, lights: Path, split: Path, out: Path) -> None:
    """Writes the scores of the baselines (`relight.evaluation.scoring.baselines`)."""
    from relight.evaluation.scoring.baselines import evaluate_baselines

    evaluate_baselines(packed, lights, split, evaluate, out, color, order)


if __name__ == "__main__":
    main.cli()
