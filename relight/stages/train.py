"""Trains one network, with its run in MLflow."""

import os
from dataclasses import asdict
from pathlib import Path

from relight.config import Loss, Model, Track, Train
from relight.files import discard
from relight.processes import STARTED_BY
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
    track: Track,
    packed: Path,
    lights: Path,
    split: Path,
    out: Path,
    curve: Path,
) -> None:
    from relight.learning import train as learning
    from relight.learning.state import fingerprint
    from relight.track import tracked

    settings = {"model": asdict(model), "loss": asdict(loss), "train": asdict(train)}
    # Beside the outputs but not declared as one: Snakemake deletes declared outputs before a retry.
    state = out.parent / "state" / out.stem
    digest = fingerprint(model, loss, train, packed, lights, split)
    with tracked(track, out.stem, digest, settings) as run:
        learning.train(model, loss, train, packed, lights, split, out, state / "state.pt", curve, run.log)
        run.finish(curve, out)
    if STARTED_BY not in os.environ:  # else Snakemake has yet to record the outputs (`Plan.settle`)
        discard(state)


if __name__ == "__main__":
    main.cli()
