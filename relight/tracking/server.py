"""Runs MLflow's server for `relight ui`, and downloads networks of registered models."""

import os
import sys
from contextlib import chdir
from pathlib import Path

from relight.config import ROOT, Track, composed
from relight.files import UserError
from relight.tracking.store import configure, connect
from relight.tracking.workflow import VIEW

RUNS_QUERY = f"?{VIEW}&orderByKey=attributes.start_time&orderByAsc=false"  # query of the page of runs


def serve(track: Track, port: int) -> None:
    """Prints the address of the runs, and becomes MLflow's server if they are in a file or a database.

    The server has one worker, which is enough for one user, and no jobs for language models.

    Args:
        track: store and experiment.
        port: of the server, on this machine only.

    Raises:
        UserError: if nothing is tracked.
    """
    if not track.uri:
        raise UserError("track.uri is null: nothing is recorded in MLflow")
    os.chdir(ROOT)
    is_server = track.uri.startswith("http")
    server = track.uri.rstrip("/") if is_server else f"http://127.0.0.1:{port}"
    _, experiment = connect(track)
    print(f"MLflow: {server}/#/experiments/{experiment}/runs{RUNS_QUERY}", flush=True)
    if is_server:
        return
    os.environ |= {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_LOGGING_LEVEL": "WARNING"}
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", track.uri, "--workers", "1"]
    os.execv(sys.executable, [*command, "--host", "127.0.0.1", "--port", str(port)])


def download_network(uri: str) -> Path:
    """Downloads the network of a model in MLflow.

    Args:
        uri: of the model, such as models:/relight@photo, at MLFLOW_TRACKING_URI or by default in the store of this
            repository.

    Returns:
        The network's file (.safetensors).

    Raises:
        UserError: if there is no such model, or it is not a network of relight.
    """
    address = os.environ.get("MLFLOW_TRACKING_URI") or composed().track.uri
    configure()
    try:
        import mlflow

        with chdir(ROOT):
            if not address or (address.startswith("sqlite:///") and not Path(address[10:]).exists()):
                raise FileNotFoundError(f"there is no store {address}")
            folder = Path(mlflow.artifacts.download_artifacts(uri, tracking_uri=address)).resolve()
        return next(folder.rglob("*.safetensors"))
    except Exception as error:  # MLflow raises exceptions of its stores
        reason = str(error).strip().split("\n")[0] or "it holds no network of relight"
        raise UserError(f"{uri} is not in MLflow ({address}): {reason}") from None
