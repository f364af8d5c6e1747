"""Trainings in MLflow: a by-product, whose failure is a warning and never the end of a training."""

import csv
import fcntl
import logging
import os
import shutil
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path

from relight.config import Track, flat
from relight.files import whole

# Before mlflow is imported: nothing is sent anywhere, its migrations don't chatter, and a server that is gone is given
# up on after seconds.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "true")
os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "ERROR")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
logging.getLogger("alembic").setLevel(logging.WARNING)

LOCK = Path(".mlflow.lock")
ARTIFACTS = "mlruns"
PATIENCE = 5.0  # seconds that a locked database is waited for
PAUSE = 100  # a store that fails is left alone for so many times as long as it took to fail


class Run:
    """The run in MLflow of the training with this name and fingerprint: found again, or made with what is first logged.

    The fingerprint is the hash of all that the training depends on, so one that goes on after a kill goes on in its own
    run, and one with other settings or data has another. What MLflow raises is told on stderr, once; what it could not
    take is kept and goes with what follows.
    """

    def __init__(self, track: Track, name: str, fingerprint: str, settings: dict):
        self.track, self.name, self.fingerprint, self.settings = track, name, fingerprint, settings
        self.start = milliseconds()
        self.id: str | None = None
        self.status = ""
        self.rows: dict[int, tuple[int, Mapping[str, float]]] = {}  # by step: when, and what; not in the store yet
        self.held: set[int] = set()  # steps that the store has
        self.told: set[str] = set()
        self.again = 0.0

    def log(self, values: Mapping[str, float], step: int) -> None:
        """Writes the losses of an epoch."""
        self.rows[step] = milliseconds(), values
        if time.monotonic() > self.again:
            self._attempt(self._send)

    def finish(self, curve: Path, *files: Path) -> None:
        """Writes what the store lacks of the losses of all epochs (CSV), and the files; ends the run."""
        with open(curve, newline="") as file:
            for row in csv.DictReader(file):
                values = {name: float(value) for name, value in row.items() if name not in ("step", "lr")}
                self.rows.setdefault(int(row["step"]), (milliseconds(), values))

        self._attempt(lambda client: (self._send(client), self._close(client, files)))

    def add(self, values: Mapping[str, float], *files: Path) -> None:
        """Writes figures about the finished training, those that are new; the run's end stays that of the training."""

        def send(client) -> None:
            from mlflow.entities import Metric

            known = client.get_run(self.id).data.metrics
            new = [Metric(name, value, milliseconds(), 0) for name, value in values.items() if known.get(name) != value]
            client.log_batch(self.id, metrics=new)
            self._close(client, files)

        self._attempt(send)

    def fail(self) -> None:
        """Marks the run as failed, where there is one."""
        if self.id:
            self._attempt(lambda client: client.set_terminated(self.id, "FAILED"))

    def _attempt(self, act: Callable) -> None:
        """Calls `act` with a client and the run opened; a failure becomes a warning."""
        began = time.monotonic()
        try:
            if not self.id:
                self._open()
            act(self.client)
        except Exception as error:  # whatever it is: no training ends because of it
            self.id = None  # what the store holds is asked anew
            reason = str(error).strip().split("\n")[0]
            if reason not in self.told:
                print(f"{self.name} is not recorded in MLflow ({self.track.uri}): {reason}", file=sys.stderr)
            self.told.add(reason)
            self.again = time.monotonic() + PAUSE * (time.monotonic() - began)

    def _open(self) -> None:
        from mlflow import MlflowClient
        from mlflow.entities import Param
        from mlflow.tracking.context.registry import resolve_tags

        with alone():
            create(self.track.uri)
            self.client = client = MlflowClient(self.track.uri)
            experiment = identify(client, self.track)
        found = client.search_runs([experiment], f"tags.fingerprint = '{self.fingerprint}'")
        run = next((run for run in found if run.info.run_name == self.name), None)
        if run is None:
            tags = resolve_tags({"fingerprint": self.fingerprint})
            run = client.create_run(experiment, start_time=self.start, tags=tags, run_name=self.name)
        elif run.info.status != "FINISHED":
            client.update_run(run.info.run_id, status="RUNNING")
        params = {key: str(value) for key, value in flat(self.settings).items()}
        new = [Param(key, value) for key, value in params.items() if key not in run.data.params]
        client.log_batch(run.info.run_id, params=new)
        self.held = {point.step for point in client.get_metric_history(run.info.run_id, "loss")}
        self.id, self.status = run.info.run_id, run.info.status

    def _send(self, client) -> None:
        from mlflow.entities import Metric

        for step, (when, values) in sorted(self.rows.items()):
            if step not in self.held:
                client.log_batch(self.id, metrics=[Metric(name, value, when, step) for name, value in values.items()])
            self.held.add(step)
            del self.rows[step]

    def _close(self, client, files: Iterable[Path]) -> None:
        if self.status != "FINISHED":  # once: its end is that of its training
            client.set_terminated(self.id, "FINISHED")
        client.log_dict(self.id, self.settings, "config.yaml")
        for file in files:
            client.log_artifact(self.id, str(file))


@contextmanager
def tracked(track: Track, name: str, fingerprint: str, settings: dict) -> Iterator[Run]:
    """The run of a training; it is marked as failed when the block is left by an exception."""
    run = Run(track, name, fingerprint, settings)
    try:
        yield run
    except BaseException:
        run.fail()
        raise


def milliseconds() -> int:
    """The time, as MLflow stores it."""
    return int(1000 * time.time())


@contextmanager
def alone() -> Iterator[None]:
    """Two processes must not make one database, nor one experiment, at once."""
    with open(LOCK, "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def identify(client, track: Track) -> str:
    """The id of the experiment, which is made where it is missing."""
    if found := client.get_experiment_by_name(track.experiment):
        return found.experiment_id
    made = client.create_experiment(track.experiment)
    create(track.uri)  # the place of its artifacts
    return made


def create(uri: str) -> None:
    """Makes the tables of a missing SQLite database, whole or not at all: MLflow cannot mend a half-made one.

    In one that is there, the places of artifacts become relative to its folder; one that is locked or damaged raises
    sqlite3's error here, since MLflow itself would try for minutes. MLflow stores them absolute, and a
    checkout that was moved would go on writing to where it was.
    """
    path = Path(uri.removeprefix("sqlite:///"))
    if not uri.startswith("sqlite:///"):
        return
    if not path.exists():
        from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

        with tempfile.TemporaryDirectory() as folder, whole(path) as tmp:  # elsewhere, since SQLite leaves its journal
            SqlAlchemyStore(f"sqlite:///{folder}/new.db", str(Path(ARTIFACTS).resolve()))
            shutil.copyfile(f"{folder}/new.db", tmp)
    if path.is_absolute():
        return
    own = f"'{ARTIFACTS}/' || experiment_id"
    with closing(sqlite3.connect(path, timeout=PATIENCE)) as store, store:
        for table, column, place in (
            ("experiments", "artifact_location", own),
            ("runs", "artifact_uri", f"{own} || '/' || run_uuid || '/artifacts'"),
        ):
            store.execute(f"UPDATE {table} SET {column} = {place} WHERE {column} LIKE '%/' || {place}")
