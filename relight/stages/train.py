"""Trains one network, with its run in MLflow."""

import os
from pathlib import Path

from relight.config import Augment, Loss, Model, Track, Train
from relight.files import remove_folder
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
    code: str = "",
) -> None:
    """Trains a network, resuming an interrupted training."""
    from relight.learning.train import Inputs, Recipe, fingerprint
    from relight.learning.train import train as train_network
    from relight.tracking.run import training_run

    recipe, inputs = Recipe(model, loss, train, augment), Inputs(packed, lights, split, code)
    # Not declared as an output, since Snakemake deletes declared outputs before a retry.
    state = out.parent / "state" / out.stem
    data = {"figures": packed, "lights": lights, "split": split}
    with training_run(track, out.stem, fingerprint(recipe, inputs), recipe.as_dict(), data) as run:
        hooks = (run.log, run.add_image) if run else ()
        train_network(recipe, inputs, out, state / "state.pt", curve, *hooks)
        if run:
            run.finish(out, curve)
    if STARTED_BY not in os.environ:  # otherwise `Plan.clean_up` removes it after Snakemake has recorded the outputs
        remove_folder(state)


if __name__ == "__main__":
    main.cli()
