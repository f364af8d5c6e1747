"""Where MLflow keeps its runs: a server or a database; a SQLite database is made where it is missing."""

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
SQLITE_TIMEOUT = 5.0  # seconds that a locked database is waited for
# Nothing is sent anywhere, migrations are not logged, and a server that is gone is given up on after seconds.
DEFAULTS = {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_LOGGING_LEVEL": "ERROR",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
}
# Else MLflow's pages show what language models need.
EXPERIMENT_TAGS = {"mlflow.experimentKind": "custom_model_development"}


def configure() -> None:
    """Sets MLflow's environment variables where the user has not; to be called before MLflow is imported."""
    for variable, value in DEFAULTS.items():
        os.environ.setdefault(variable, value)
    logging.getLogger("alembic").setLevel(logging.WARNING)


def connect(track: Track) -> tuple:
    """Connects to the store, and makes the database and the experiment where they are missing.

    Args:
        track: the address, a SQLite file, a database or a server; and the name of the experiment.

    Returns:
        An `MlflowClient`, and the id of the experiment.

    Raises:
        Exception: whatever the store raises.
    """
    assert track.uri  # who records nothing asks for no store
    configure()
    from mlflow import MlflowClient

    with lock():
        create_database(track.uri)
        client = MlflowClient(track.uri)
        if found := client.get_experiment_by_name(track.experiment):
            return client, found.experiment_id
        experiment = client.create_experiment(track.experiment, tags=EXPERIMENT_TAGS)
        create_database(track.uri)  # whose new experiment has its artifacts at an absolute path
        return client, experiment


@contextmanager
def lock() -> Iterator[None]:
    """Held while a database, an experiment or a run is looked for and made: two processes must not make one twice."""
    with open(LOCK, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def create_database(uri: str) -> None:
    """Makes the tables of a missing SQLite database, and the paths of artifacts relative to its folder.

    The tables are made whole or not at all, since MLflow cannot repair a half-made database. MLflow stores absolute
    paths, so a checkout that was moved would go on writing to where it was. Other stores are left alone.

    Args:
        uri: of the store.

    Raises:
        sqlite3.Error: the database is locked or damaged; MLflow itself would try for minutes.
    """
    path = Path(uri.removeprefix("sqlite:///"))
    if not uri.startswith("sqlite:///"):
        return
    if not path.exists():
        configure()
        from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

        with tempfile.TemporaryDirectory() as folder, atomic_write(path) as tmp:  # SQLite leaves its journal there
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
