"""Connects to the store of MLflow's runs, a server or a database, and creates missing SQLite databases."""

import fcntl
import logging
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from relight.config import Track
from relight.files import atomic_write

LOCK = Path(".mlflow.lock")
ARTIFACTS = "mlruns"
SQLITE_TIMEOUT = 5.0  # seconds to wait for a locked database
# No telemetry, no logs of migrations, and short timeouts for unreachable servers.
DEFAULTS = {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_LOGGING_LEVEL": "ERROR",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
}
# Otherwise MLflow's pages are those for language models.
EXPERIMENT_TAGS = {"mlflow.experimentKind": "custom_model_development"}


def configure() -> None:
    """Sets MLflow's environment variables, unless the user has; to be called before MLflow is imported."""
    for variable, value in DEFAULTS.items():
        os.environ.setdefault(variable, value)
    logging.getLogger("alembic").setLevel(logging.WARNING)


def connect(track: Track) -> tuple:
    """Connects to the store, and creates a missing database and experiment.

    Args:
        track: address of a SQLite file, a database or a server, and name of the experiment.

    Returns:
        An `MlflowClient`, and the id of the experiment.

    Raises:
        Exception: any exception of the store.
    """
    assert track.uri  # without tracking, no store is opened
    configure()
    from mlflow import MlflowClient

    with lock():
        create_database(track.uri)
        client = MlflowClient(track.uri)
        if found := client.get_experiment_by_name(track.experiment):
            return client, found.experiment_id
        experiment = client.create_experiment(track.experiment, tags=EXPERIMENT_TAGS)
        create_database(track.uri)  # makes the path of the new experiment's artifacts relative
        return client, experiment


@contextmanager
def lock() -> Iterator[None]:
    """Locks the store, so that two processes do not create the same database, experiment or run."""
    with open(LOCK, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def create_database(uri: str) -> None:
    """Creates a missing SQLite database, and makes its paths of artifacts relative to its folder.

    The database is written atomically, since MLflow cannot repair an incomplete one. MLflow stores absolute paths, so a
    repository that was moved would write to its old place. Other stores are not changed.

    Args:
        uri: of the store.

    Raises:
        sqlite3.Error: if the database is locked or damaged; MLflow itself would try for minutes.
    """
    path = Path(uri.removeprefix("sqlite:///"))
    if not uri.startswith("sqlite:///"):
        return
    if not path.exists():
        configure()
        from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

        with (
            tempfile.TemporaryDirectory() as folder,
            atomic_write(path) as tmp,
        ):  # SQLite writes its journal to the folder
            SqlAlchemyStore(f"sqlite:///{folder}/new.db", str(Path(ARTIFACTS).resolve()))
            shutil.copyfile(f"{folder}/new.db", tmp)
    if path.is_absolute():
        return
    experiment = f"'{ARTIFACTS}/' || experiment_id"
    with closing(sqlite3.connect(path, timeout=SQLITE_TIMEOUT)) as store, store:
        for table, column, relative in (
            ("experiments", "artifact_location", experiment),
            ("runs", "artifact_uri", f"{experiment} || '/' || run_uuid || '/artifacts'"),
            ("logged_models", "artifact_location", f"{experiment} || '/models/' || model_id || '/artifacts'"),
        ):
            store.execute(f"UPDATE {table} SET {column} = {relative} WHERE {column} LIKE '%/' || {relative}")
