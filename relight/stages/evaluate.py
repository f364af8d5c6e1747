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
    plate="pictures of some of the figures (.png)",
)
def main(
    evaluate: Evaluate, track: Track, packed: Path, lights: Path, split: Path, network: Path, out: Path, plate: Path
) -> None:
    from relight.evaluation.evaluate import evaluate as score
    from relight.evaluation.plates import plates
    from relight.evaluation.scores import read_scores
    from relight.track import tracked

    score(network, packed, lights, split, evaluate, out)
    plates({network.stem.rpartition(".s")[0]: network}, packed, lights, split, evaluate, plate)
    on = "test" if (evaluate.figures, evaluate.lights) == ("test", "test") else f"{evaluate.figures}-{evaluate.lights}"
    scores = next(iter(read_scores(out).values()), None)
    means = {f"{on}.{name}": float(values.mean()) for name, values in (scores.columns if scores else {}).items()}
    with tracked(track, network.stem, network.parent / "state" / network.stem / "mlflow.txt") as mlflow:
        mlflow.log_metrics({name: value for name, value in means.items() if value == value})
        mlflow.log_artifact(out)
        mlflow.log_artifact(plate)


if __name__ == "__main__":
    main.cli()
