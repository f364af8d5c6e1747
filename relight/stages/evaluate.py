"""Scores one network on every figure under every light of a condition, and adds the means to its run in MLflow."""

from pathlib import Path

from relight.config import Evaluate, Track
from relight.stages.stage import stage


@stage(
    "evaluate",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    network="network (.safetensors)",
    out="scores (.csv)",
)
def main(evaluate: Evaluate, track: Track, packed: Path, lights: Path, split: Path, network: Path, out: Path) -> None:
    """Writes the scores of a network, one row per figure and light, and sends their means to its run in MLflow."""
    from relight.evaluation.scoring.evaluate import evaluate as score
    from relight.evaluation.scoring.scores import read_scores
    from relight.learning.checkpoint import read_config
    from relight.tracking.run import log_scores

    score(network, packed, lights, split, evaluate, out)
    on = "test" if (evaluate.figures, evaluate.lights) == ("test", "test") else f"{evaluate.figures}-{evaluate.lights}"
    scores = next(iter(read_scores(out).values()), None)
    means = {name: float(values.mean()) for name, values in (scores.columns if scores else {}).items()}
    finite = {name: mean for name, mean in means.items() if mean == mean}
    log_scores(track, network, read_config(network), on, finite, out)


if __name__ == "__main__":
    main.cli()
