"""Opens the store of MLflow's runs: a SQLite file, a database or a server."""

import fcntl
import logging
import os
import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlparse
from urllib.request import url2pathname

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.settings import Track

SQLITE = "sqlite:///"
LOCK = Path(".mlflow.lock")
ARTIFACTS = Path("mlruns")
SQLITE_TIMEOUT = 5.0  # seconds to wait for a locked database
# No telemetry, no logs of migrations, no list of variables that a model reads, which fails if a thread reads some
# meanwhile, short timeouts for unreachable servers, and a source that is not the temporary script of a job.
DEFAULTS = {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_LOGGING_LEVEL": "ERROR",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_RECORD_ENV_VARS_IN_MODEL_LOGGING": "false",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
    "MLFLOW_RUN_CONTEXT": '{"mlflow.source.name": "relight run"}',
}
# Otherwise MLflow's pages are those for language models.
EXPERIMENT_TAGS = {
    "mlflow.experimentKind": "custom_model_development",
    "mlflow.note.content": "Trainings of relight. Losses are comparable among runs with one `loss` alone; the scores, "
    "`test_...`, among all.",
}


def select_store(uri: str) -> None:
    """Selects the store of this process; MLflow must not have been imported before."""
    for variable in ("MLFLOW_RUN_ID", "MLFLOW_ACTIVE_MODEL_ID"):  # somebody else's, as `mlflow run` and Databricks set
        os.environ.pop(variable, None)
    for variable, value in DEFAULTS.items():
        os.environ.setdefault(variable, value)
    logging.getLogger("alembic").setLevel(logging.WARNING)
    import mlflow

    mlflow.set_tracking_uri(uri)


def connect(track: Track) -> tuple[Any, str]:
    """Selects a store, and creates a missing database and experiment.

    Args:
        track: address of a SQLite file, a database or a server, and name of the experiment.

    Returns:
        An `MlflowClient`, and the id of the experiment.

    Raises:
        Exception: any exception of the store.
        UserError: if the folder of the experiment's artifacts is gone.
    """
    assert track.uri  # without an address, no store is opened
    select_store(track.uri)
    from mlflow import MlflowClient

    with open(LOCK, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # so that two processes do not create the same database or experiment
        create_database(track.uri)
        client = MlflowClient()
        if (experiment := client.get_experiment_by_name(track.experiment)) is None:
            # An address, since MLflow takes a path for one, whatever characters it holds. A server has its own place.
            address = None if track.uri.startswith("http") else ARTIFACTS.resolve().as_uri()
            return client, client.create_experiment(track.experiment, address, EXPERIMENT_TAGS)
    place = urlparse(experiment.artifact_location)
    if place.scheme == "file" and not (folder := Path(url2pathname(place.path))).parent.exists():
        raise UserError(f"{folder} is gone: a clone that was moved needs another track.experiment")
    return client, experiment.experiment_id


def create_database(uri: str) -> None:
    """Creates a missing SQLite database, whole or not at all, since MLflow cannot repair an incomplete one.

    Args:
        uri: address of the store; nothing is done for others.

    Raises:
        sqlite3.Error: if the database is locked or damaged; MLflow itself would try for minutes.
    """
    path = Path(uri.removeprefix(SQLITE))
    if not uri.startswith(SQLITE):
        return
    if not path.exists():
        from mlflow import MlflowClient

        with tempfile.TemporaryDirectory() as folder, atomic_write(path) as temporary:
            MlflowClient(f"{SQLITE}{folder}/new.db").search_experiments()
            shutil.copyfile(f"{folder}/new.db", temporary)
    with closing(sqlite3.connect(path, timeout=SQLITE_TIMEOUT)) as database:
        database.execute("SELECT name FROM sqlite_master")
