"""Scores one network on every figure under every light of a condition, and adds the means to its run in MLflow."""

import math
from pathlib import Path

from relight.config import Track
from relight.stages.stage import stage


@stage(
    "evaluate",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    network="network (.safetensors)",
    condition="what is scored: test, or FIGURES-LIGHTS such as sitting-test",
    out="scores (.csv)",
)
def main(track: Track, packed: Path, lights: Path, split: Path, network: Path, condition: str, out: Path) -> None:
    """Writes the scores of a network, one row per figure and light, and sends their means to its run in MLflow."""
    from relight.evaluation.scoring.evaluate import Condition, evaluate
    from relight.evaluation.scoring.scores import read_scores
    from relight.learning.checkpoint import read_config
    from relight.tracking.run import log_scores

    evaluate(network, packed, lights, split, Condition.parse(condition), out)
    scores = next(iter(read_scores(out).values()), None)  # None if the condition has no figures or no lights
    means = {name: float(values.mean()) for name, values in (scores.columns if scores else {}).items()}
    known = {name: mean for name, mean in means.items() if not math.isnan(mean)}
    log_scores(track, network, read_config(network), condition, known, out)


if __name__ == "__main__":
    main.cli()
