"""Runs MLflow's server for `relight ui`."""

import os
import socket
import sys
from pathlib import Path

from relight.core.errors import UserError
from relight.lab.tracking.store import SQLITE, connect, select_store
from relight.settings import ROOT, Track

# The list of runs beside their curves; without a type MLflow's pages are for language models. Sorted by the time alone,
# MLflow folds trainings into the run of their report, and draws no curves.
VIEW = "?workflowType=machine_learning&compareRunsMode=CHART&orderByKey=tags.%60mlflow.user%60"


def serve(track: Track, port: int) -> None:
    """Prints the address of the runs, and becomes MLflow's server if they are in a file or a database.

    The server has one worker, which is enough for one user, and no jobs for language models.

    Args:
        track: store and experiment.
        port: port of the server, on this machine only.

    Raises:
        UserError: if nothing is tracked, there is no such experiment, or the port is taken.
    """
    if not track.uri:
        raise UserError("track.uri is null: nothing is recorded in MLflow")
    os.chdir(ROOT)
    is_server = track.uri.startswith("http")
    server = track.uri.rstrip("/") if is_server else f"http://127.0.0.1:{port}"
    if not is_server:
        _require_free(port)
    print(f"MLflow: {server}/#/experiments/{_experiment(track)}/runs{VIEW}", flush=True)
    if is_server:
        return
    os.environ |= {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_LOGGING_LEVEL": "WARNING"}
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", track.uri, "--workers", "1"]
    os.execv(sys.executable, [*command, "--host", "127.0.0.1", "--port", str(port)])


def _experiment(track: Track) -> str:
    """Returns the id of an experiment. Raises UserError if the store has others, and none of this name."""
    database = Path(str(track.uri).removeprefix(SQLITE))
    if database.exists() or not str(track.uri).startswith(SQLITE):
        select_store(str(track.uri))
        from mlflow import MlflowClient

        ids = {found.name: found.experiment_id for found in MlflowClient().search_experiments()}
        name, others = track.experiment, ", ".join(sorted(ids.keys() - {"Default", track.experiment}))
        if others and name not in ids:
            raise UserError(
                f"{track.uri} has no experiment {name}: `relight run name={name}` makes it; there are {others}"
            )
    return connect(track)[1]


def _require_free(port: int) -> None:
    """Raises UserError for a port that another program has, or that the system does not give."""
    address = "127.0.0.1", port
    with socket.socket() as caller, socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as servers do: closed just now is free
        try:
            if caller.connect_ex(address) == 0:  # macOS lets one bind where AirPlay answers
                raise OSError
            listener.bind(address)
        except OSError as error:
            why = error.strerror or "another program answers there"
            raise UserError(f"port {port} cannot be used ({why}): give another with --port") from None
