"""The jobs of one network, trained and scored, with its run in MLflow."""

import json
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from relight import extensions
from relight.core.files import existing_file, file_hash
from relight.lab.code import code_hash
from relight.lab.tracking.run import log_scores, training_run
from relight.learning.train import Inputs, Recipe, fingerprint
from relight.learning.train import train as train_network
from relight.settings import ROOT, Augment, Loss, Model, Train


def train(settings: dict[str, Any], inputs: Inputs, out: Path, curve: Path, tracking: dict[str, Any]) -> None:
    """Trains a network, or resumes an interrupted training.

    Its state is in the folder state/<training> beside the network. It is not declared as an output, since Snakemake
    deletes declared outputs before a retry.

    Args:
        settings: of the training, by group.
        inputs: data.
        out: network (.safetensors); its stem is the name of the training.
        curve: losses per epoch (.csv).
        tracking: of the workflow (`Plan.tracking`).
    """
    recipe = Recipe(
        Model(**settings["model"]), Loss(**settings["loss"]), Train(**settings["train"]), Augment(**settings["augment"])
    )
    packed = existing_file(inputs.packed, "training")
    data = {"name": packed.parent.name, "digest": file_hash(packed)[:36]}  # MLflow's longest
    tracking["datasets"] = [{**data, "source_type": "local", "source": json.dumps({"uri": str(packed.resolve())})}]
    # What is the same in each process that goes on, whatever it has imported.
    modules = [f"relight.learning.{file.stem}" for file in sorted((ROOT / "relight" / "learning").glob("*.py"))]
    named = sorted({recipe.model.name, *recipe.loss.extra} & {*extensions.names()})
    modules += [extensions.installed().get(name, f"relight.extensions.{name}") for name in named]
    inputs = replace(inputs, code=repr([*map(code_hash, modules)]))
    with training_run(tracking, out.stem, fingerprint(recipe, inputs), asdict(recipe)) as run:
        state = out.parent / "state" / out.stem / "state.pt"
        train_network(recipe, inputs, out, state, curve, run.log if run else None)
        if run:
            run.finish(out, curve)


def evaluate(
    network: Path, packed: Path, lights: Path, split: Path, condition: str, out: Path, tracking: dict[str, Any]
) -> None:
    """Writes the scores of a network, one row per figure and light, and sends their means to its run in MLflow.

    Args:
        network, packed, lights, split: files.
        condition: what is scored: test, or FIGURES-LIGHTS such as sitting-test.
        out: scores (.csv).
        tracking: of the workflow (`Plan.tracking`).
    """
    from relight.evaluation.scoring.evaluate import evaluate as score
    from relight.evaluation.scoring.scores import read_scores

    score(network, packed, lights, split, condition, out)
    scores = next(iter(read_scores(out).values()), None)  # None if the condition has no figures or no lights
    columns = scores.columns if scores else {}
    means = {name: mean for name, values in columns.items() if not math.isnan(mean := float(values.mean()))}
    log_scores(tracking, network, condition, means, out)
