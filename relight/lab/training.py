"""The training of one network, with its run in MLflow."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from relight import extensions
from relight.core.files import existing_file, file_hash
from relight.lab.code import code_hash
from relight.lab.tracking.run import training_run
from relight.learning.train import Inputs, Recipe, fingerprint
from relight.learning.train import train as train_network
from relight.settings import ROOT, Augment, Loss, Model, Train

PACKAGES = "sh", "maps", "lights", "learning"  # whose code a state is of


def train(settings: dict[str, Any], inputs: Inputs, out: Path, curve: Path, tracking: dict[str, Any]) -> None:
    """Trains a network, or resumes an interrupted training.

    Its state is in the folder state/<training> beside the network. It is not declared as an output, since Snakemake
    deletes declared outputs before a retry.

    Args:
        settings: of the training, by group.
        inputs: data.
        out: network (.safetensors); its stem is the name of the training.
        curve: all logged values, a row per epoch (.csv).
        tracking: of the workflow (`Plan.tracking`).
    """
    recipe = Recipe(
        Model(**settings["model"]), Loss(**settings["loss"]), Train(**settings["train"]), Augment(**settings["augment"])
    )
    packed = existing_file(inputs.packed, "training")
    data = {"name": packed.parent.name, "digest": file_hash(packed)[:36]}  # MLflow's longest
    tracking["datasets"] = [{**data, "source_type": "local", "source": json.dumps({"uri": str(packed.resolve())})}]
    # What is the same in each process that goes on, whatever it has imported.
    files = sorted(file for package in PACKAGES for file in (ROOT / "relight" / package).glob("*.py"))
    modules = [f"relight.{file.parent.name}.{file.stem}" for file in files]
    named = sorted({recipe.model.name, *recipe.loss.extra} & {*extensions.names()})
    modules += [extensions.installed().get(name, f"relight.extensions.{name}") for name in named]
    inputs = replace(inputs, code=repr([*map(code_hash, modules)]))
    with training_run(tracking, out.stem, fingerprint(recipe, inputs), asdict(recipe)) as run:
        state = out.parent / "state" / out.stem / "state.pt"
        train_network(recipe, inputs, out, state, curve, run.log if run else None)
        if run:
            run.finish(out, curve)
