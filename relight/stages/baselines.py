"""Scores the baselines on the same pairs as the networks."""

from pathlib import Path

from relight.stages.stage import stage


@stage(
    "baselines",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    condition="what is scored: test, or FIGURES-LIGHTS such as sitting-test",
    out="scores (.csv)",
)
def main(color: str, order: int, packed: Path, lights: Path, split: Path, condition: str, out: Path) -> None:
    """Writes the scores of the baselines (`relight.evaluation.scoring.baselines`).

    Args:
        color: color model of the networks with which they are compared, train.color.
        order: of the data, bake.order.
        packed, lights, split, out: files.
        condition: name of the figures and lights.
    """
    from relight.evaluation.scoring.baselines import evaluate_baselines
    from relight.evaluation.scoring.evaluate import Condition

    evaluate_baselines(packed, lights, split, Condition.parse(condition), out, color, order)


if __name__ == "__main__":
    main.cli()
