"""Runs in MLflow: the database made once, the run of a killed job found again."""

import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from relight.config import Track
from relight.files import whole

# Before mlflow is imported: nothing is sent anywhere, and its migrations don't chatter.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "true")
os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "WARNING")
logging.getLogger("alembic").setLevel(logging.WARNING)

LOCK = Path(".mlflow.lock")
ARTIFACTS = Path("mlruns")


def create(uri: str) -> None:
    """Makes the tables of a missing SQLite database, whole or not at all: MLflow cannot mend a half-made one."""
    path = Path(uri.removeprefix("sqlite:///"))
    if not uri.startswith("sqlite:///") or path.exists():
        return
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

    with whole(path) as tmp:
        SqlAlchemyStore(f"sqlite:///{tmp}", ARTIFACTS.resolve().as_uri())


@contextmanager
def tracked(track: Track, name: str, record: Path, params: dict | None = None) -> Iterator[ModuleType]:
    """Makes the MLflow run whose id `record` holds the active one, or a new one called `name`; yields mlflow.

    `record` outlives the job: a killed one finds its run again, and later stages add to the same run. Parameters
    are logged when the run is new, since MLflow refuses a changed value.
    """
    import mlflow

    with open(LOCK, "w") as lock:  # two processes must not create one database, nor one experiment, at once
        fcntl.flock(lock, fcntl.LOCK_EX)
        create(track.uri)
        mlflow.set_tracking_uri(track.uri)
        mlflow.set_experiment(track.experiment)
    run_id = record.read_text() if record.exists() else None
    if run_id is not None and not known(run_id):
        run_id = None
    with mlflow.start_run(run_id=run_id, run_name=None if run_id else name) as run:
        if run_id is None:
            with whole(record) as tmp:
                tmp.write_text(run.info.run_id)
            if params:
                mlflow.log_params(params)
        yield mlflow


def known(run_id: str) -> bool:
    """Whether the store still has the run: a user may have removed the database."""
    import mlflow
    from mlflow.exceptions import MlflowException

    try:
        return mlflow.get_run(run_id).info.lifecycle_stage == "active"
    except MlflowException:
        return False
