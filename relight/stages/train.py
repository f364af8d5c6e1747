"""Trains one network, with its run in MLflow."""

import os
from dataclasses import asdict
from pathlib import Path

from relight.config import Augment, Loss, Model, Track, Train
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
    augment: Augment,
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

    groups = {"model": model, "loss": loss, "train": train, "augment": augment}
    settings = {name: asdict(group) for name, group in groups.items()}
    # Beside the outputs but not declared as one: Snakemake deletes declared outputs before a retry.
    state = out.parent / "state" / out.stem
    digest = fingerprint(*groups.values(), packed, lights, split)
    data = {"figures": packed, "lights": lights, "split": split}
    with tracked(track, out.stem, digest, settings, data) as run:
        shown = run.show if run.track.uri else None
        learning.train(*groups.values(), *data.values(), out, state / "state.pt", curve, run.log, shown)
        run.finish(curve, out)
    if STARTED_BY not in os.environ:  # else Snakemake has yet to record the outputs (`Plan.settle`)
        discard(state)


if __name__ == "__main__":
    main.cli()
