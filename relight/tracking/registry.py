"""Networks as versions of the registered model `relight`: `models:/relight@paper` and `models:/relight@photo`."""

import math
import os
from collections.abc import Mapping
from contextlib import chdir, suppress
from pathlib import Path

from relight.config import ROOT, Track, composed
from relight.errors import UserError
from relight.tracking.store import SQLITE, connect, find_run, model_of, select_store, warn

MODEL = "relight"  # the registered model
ROWS = {"paper": "ours_full", "photo": "photo"}  # color model and alias -> row of the network
SCORE = "loss/validation"  # by which the best of a row's trainings is chosen


def finish_workflow(track: Track, networks: Mapping[str, Path | str], clone: str) -> None:
    """Registers the networks of a workflow that ended, well or not, and marks trainings that were killed.

    Args:
        track: store and experiment.
        networks: files of its trainings, by name.
        clone: tag of the runs of this clone, in which one workflow runs at a time.
    """
    from relight.learning.checkpoint import read_config

    if not track.uri or not any(Path(path).parent.exists() for path in networks.values()):
        return
    try:
        client, experiment = connect(track)
        for run in client.search_runs([experiment], "attributes.status = 'RUNNING'"):
            if run.data.tags.get("clone") == clone:
                client.set_terminated(run.info.run_id, "KILLED")
        trained = {name: read_config(path) for name, path in networks.items() if Path(path).exists()}
        runs = [find_run(client, experiment, name, config.get("fingerprint", "")) for name, config in trained.items()]
        register(client, [run for run in runs if run])
    except Exception as error:  # of any kind: MLflow raises those of its stores
        warn("the best network", track, error, reasons=set())


def register(client, runs: list) -> None:
    """Registers, for each color model, the network of its row with the least validation loss, under the alias.

    Args:
        client: an `MlflowClient`.
        runs: runs of trainings.
    """
    from mlflow.exceptions import MlflowException

    for color, row in ROWS.items():
        candidates = [
            run
            for run in runs
            if run.data.tags.get("row") == row and run.data.params.get("train.color") == color and model_of(run)
        ]
        if not candidates:
            continue
        best = min(candidates, key=lambda run: run.data.metrics.get(SCORE, math.inf))
        with suppress(MlflowException):  # it exists
            client.create_registered_model(MODEL, description="Networks of relight; the aliases name color models.")
        model, run = model_of(best), best.info.run_id
        versions = client.search_model_versions(f"name = '{MODEL}' and run_id = '{run}'")
        if not versions:
            versions = [client.create_model_version(MODEL, f"models:/{model}", run, model_id=model)]
        client.set_registered_model_alias(MODEL, color, versions[0].version)


def download_network(uri: str) -> Path:
    """Downloads the network of a model in MLflow.

    Args:
        uri: address of the model, such as models:/relight@paper, at MLFLOW_TRACKING_URI or by default in the store of
            this repository.

    Returns:
        The network's file (.safetensors).

    Raises:
        UserError: if there is no such model, or it is not a network of relight.
    """
    address = os.environ.get("MLFLOW_TRACKING_URI") or composed().track.uri
    try:
        with chdir(ROOT):
            if not address or (address.startswith(SQLITE) and not Path(address.removeprefix(SQLITE)).exists()):
                raise FileNotFoundError(f"there is no store {address}")
            select_store(address)
            import mlflow

            folder = Path(mlflow.artifacts.download_artifacts(uri)).resolve()
        return next(folder.rglob("*.safetensors"))
    except Exception as error:  # MLflow passes on any exception of its store
        reason = str(error).strip().split("\n")[0] or "it holds no network of relight"
        raise UserError(f"{uri} is not in MLflow ({address}): {reason}") from None
