"""Trains one network, with its run in MLflow."""

from dataclasses import asdict
from pathlib import Path

from relight.config import Augment, Loss, Model, Track, Train, flat
from relight.stages.stage import stage


@stage(
    "train",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    out="network (.safetensors)",
    curve="losses per epoch (.csv)",
)
def main(
    model: Model,
    loss: Loss,
    train: Train,
    augment: Augment,
    track: Track,
    packed: Path,
    lights: Path,
    split: Path,
    out: Path,
    curve: Path,
) -> None:
    from relight.learning import train as learning
    from relight.track import tracked

    groups = {"model": model, "loss": loss, "train": train, "augment": augment}
    settings = {name: asdict(group) for name, group in groups.items()}
    # Beside the outputs but not declared as one: Snakemake deletes declared outputs before a retry.
    state = out.parent / "state" / out.stem
    with tracked(track, out.stem, state / "mlflow.txt", flat(settings)) as mlflow:
        mlflow.log_dict(settings, "config.yaml")
        learning.train(
            model,
            loss,
            train,
            augment,
            packed,
            lights,
            split,
            out,
            state / "state.pt",
            curve,
            lambda values, step: mlflow.log_metrics(values, step=step),
        )
        mlflow.log_artifact(out)


if __name__ == "__main__":
    main.cli()
