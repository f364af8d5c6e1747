"""Trainings and workflows in MLflow: a by-product, whose failure is a warning and never the end of a training."""

import csv
import fcntl
import hashlib
import json
import logging
import os
import shutil
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import chdir, closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from relight import __version__
from relight.config import ROOT, Track, composed, flat
from relight.files import UserError, atomic_write

# Before mlflow is imported: nothing is sent anywhere, its migrations don't chatter, and a server that is gone is given
# up on after seconds.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "true")
os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "ERROR")
os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
logging.getLogger("alembic").setLevel(logging.WARNING)

WORKFLOW = "RELIGHT_WORKFLOW"  # in a stage's environment: the Workflow that it works for, as JSON
MODEL = "relight"  # the registered model
RUNS = "?workflowType=machine_learning&orderByKey=attributes.start_time&orderByAsc=false"  # of the runs' page
NOTE = """\
`loss` and its parts are means over the steps since the last point, `validation/` the same on a few fixed pairs of test
figures and test lights, `test/` the means over all of them (docs/evaluation.md). Pictures have a column each for the
picture, the albedo, the shading, a ball in the light, and the figure in another light; the truth stands above what was
inferred. Nothing is chosen by them but the registered model.
"""
KIND = {"mlflow.experimentKind": "custom_model_development"}  # else MLflow shows what language models need
SCORE = "test/shading_rmse"  # by which the best network of a workflow is chosen
LOCK = Path(".mlflow.lock")
ARTIFACTS = "mlruns"
PATIENCE = 5.0  # seconds that a locked database is waited for
PAUSE = 100  # a store that fails is left alone for so many times as long as it took to fail
MOST = 100  # parameters that MLflow takes at once
LARGEST = 32 << 20  # bytes of a file that is kept with a workflow's run


@dataclass(frozen=True)
class Workflow:
    """What stages tell of the workflow that they work for.

    track: where it is tracked; name: of its results; fingerprint: of its settings; rows: each with the experiments that
    compare it; tags: of its run and of those below it; start: when it began, as MLflow stores it.
    """

    track: Track
    name: str
    fingerprint: str
    settings: dict
    rows: dict[str, list[str]]
    tags: dict[str, str] = field(default_factory=dict)
    start: int = 0

    @staticmethod
    def here() -> "Workflow | None":
        """The workflow that this process is a stage of."""
        if not (told := os.environ.get(WORKFLOW)):
            return None
        fields = json.loads(told)
        return Workflow(**{**fields, "track": Track(**fields["track"])})

    def dumps(self) -> str:
        """As JSON, for the environment of the stages."""
        return json.dumps(asdict(self))


class Run:
    """A run in MLflow: found again by its name and fingerprint, or made with what is first logged.

    The fingerprint is the hash of all that the training depends on, so one that goes on after a kill goes on in its own
    run, and one with other settings or data has another. What MLflow raises is told on stderr, once; what it could not
    take is kept and goes with what follows. Without an address nothing is tracked.
    """

    def __init__(
        self,
        track: Track,
        name: str,
        fingerprint: str,
        settings: dict,
        tags: Mapping[str, str] | None = None,
        above: "Run | None" = None,
        start: int = 0,
    ):
        """above: the run that this one is nested in. start: when it began; now by default."""
        self.track, self.name, self.fingerprint, self.settings = track, name, fingerprint, settings
        self.tags, self.above, self.start = dict(tags or {}), above, start or milliseconds()
        self.id: str | None = None
        self.status = ""
        self.rows: dict[int, tuple[int, Mapping[str, float]]] = {}  # by step: when, and what; not in the store yet
        self.pictures: dict[int, np.ndarray] = {}  # the same
        self.held: set[int] = set()  # steps that the store has
        self.shown: set[int] = set()
        self.told: set[str] = set()
        self.again = 0.0

    def log(self, values: Mapping[str, float], step: int) -> None:
        """Writes the values of an epoch."""
        self.rows[step] = milliseconds(), values
        if time.monotonic() > self.again:
            self._attempt(lambda client: (self._send(client), self._draw(client)))

    def show(self, picture: np.ndarray, step: int) -> None:
        """Keeps the picture (H,W,3) uint8 of an epoch for the next `log`."""
        self.pictures[step] = picture

    def _attempt(self, act: Callable) -> None:
        """Calls `act` with a client and the run opened; a failure becomes a warning."""
        if not self.track.uri:
            return
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

        with alone():
            create(self.track.uri)
            self.client = client = MlflowClient(self.track.uri)
            experiment = identify(client, self.track)
            run = self._found(client, experiment)
        self.id, self.status = run.info.run_id, run.info.status
        self.held = {point.step for point in client.get_metric_history(self.id, "loss")}
        if self.pictures:  # those of a training that was killed between a picture and its losses are there
            self.shown = {int(item.path.split("+step+")[1].split("+")[0]) for item in listed(client, self.id, "images")}

    def _found(self, client, experiment: str):
        """The run as the store has it, with all its parameters; made where it is missing."""
        from mlflow.entities import Param
        from mlflow.tracking.context.registry import resolve_tags

        found = client.search_runs([experiment], f"tags.fingerprint = '{self.fingerprint}'")
        run = next((run for run in found if run.info.run_name == self.name), None)
        if run is None:
            tags = {**self.tags, "fingerprint": self.fingerprint, "relight.version": __version__}
            if self.above:
                tags["mlflow.parentRunId"] = self.above._found(client, experiment).info.run_id
            run = client.create_run(experiment, start_time=self.start, tags=resolve_tags(tags), run_name=self.name)
        elif run.info.status != "FINISHED":
            client.update_run(run.info.run_id, status="RUNNING")
        params = {key: str(value) for key, value in flat(self.settings).items()}
        new = [Param(key, value) for key, value in params.items() if key not in run.data.params]
        for first in range(0, len(new), MOST):
            client.log_batch(run.info.run_id, params=new[first : first + MOST])
        return run

    def _send(self, client) -> None:
        from mlflow.entities import Metric

        for step, (when, values) in sorted(self.rows.items()):
            if step not in self.held:
                client.log_batch(self.id, metrics=[Metric(name, value, when, step) for name, value in values.items()])
            self.held.add(step)
            del self.rows[step]

    def _draw(self, client) -> None:
        for step, picture in sorted(self.pictures.items()):
            if step not in self.shown:
                client.log_image(self.id, picture, key="validation", step=step, synchronous=True)
            self.shown.add(step)
            del self.pictures[step]

    def _end(self, client, status: str = "FINISHED") -> None:
        if self.status != "FINISHED":  # once: its end is that of its training
            client.set_terminated(self.id, status)

    def _keep(self, client, files: Iterable[Path]) -> None:
        client.log_dict(self.id, self.settings, "config.yaml")
        for file in files:
            client.log_artifact(self.id, str(file))


class Training(Run):
    """The run of a training; of a workflow, it is nested in the workflow's run.

    data: the files that it depends on, by what they are; each is an input of the run, with its hash.
    """

    def __init__(
        self, track: Track, name: str, fingerprint: str, settings: dict, data: Mapping[str, Path] | None = None
    ):
        flow, row = Workflow.here(), name.rpartition(".s")
        tags = {"row": row[0] or name, "seed": row[2]} if row[0] else {"row": name}
        if flow:
            tags |= {**flow.tags, "experiment": ", ".join(flow.rows.get(tags["row"], []))}
        tags["mlflow.note.content"] = NOTE
        super().__init__(flow.track if flow else track, name, fingerprint, settings, tags, flow and overall(flow))
        self.data = dict(data or {})
        self.monitors: list = []

    def log(self, values: Mapping[str, float], step: int) -> None:
        """Writes the losses of an epoch, and how busy the machine was in it."""
        super().log({**values, **self._busy()} if self.track.uri else values, step)

    def _busy(self) -> dict[str, float]:
        """MLflow's system metrics since the last call, of its own monitors."""
        try:
            if not self.monitors:
                from mlflow.system_metrics.metrics.cpu_monitor import CPUMonitor
                from mlflow.system_metrics.metrics.gpu_monitor import GPUMonitor

                self.monitors = [CPUMonitor()]
                with suppress(Exception):  # no GPU of NVIDIA's, or no library to ask it
                    self.monitors.append(GPUMonitor())
            found = {}
            for monitor in self.monitors:
                monitor.collect_metrics()
                found |= {f"system/{name}": float(value) for name, value in monitor.aggregate_metrics().items()}
                monitor.clear_metrics()
            return found
        except Exception:  # whatever it is: told by what follows, if MLflow is the reason
            return {}

    def _found(self, client, experiment: str):
        from mlflow.entities import Dataset, DatasetInput, InputTag

        run = super()._found(client, experiment)
        if not run.inputs.dataset_inputs and self.data:
            inputs = []
            for name, path in self.data.items():
                with open(path, "rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                client.set_tag(run.info.run_id, f"data.{name}", digest)
                about = json.dumps({"bytes": path.stat().st_size, "sha256": digest})
                made = Dataset(name, digest[:36], "local", json.dumps({"uri": str(path)}), profile=about)
                inputs.append(DatasetInput(made, [InputTag("mlflow.data.context", "training")]))
            client.log_inputs(run.info.run_id, inputs)
        return run

    def finish(self, curve: Path, network: Path) -> None:
        """Writes what the store lacks of the values of all epochs (CSV); ends the run; adds the network as a model."""
        with open(curve, newline="") as file:
            for row in csv.DictReader(file):
                values = {name: float(value) for name, value in row.items() if name != "step" and value}
                self.rows.setdefault(int(row["step"]), (milliseconds(), values))

        def send(client) -> None:
            self._send(client)
            self._end(client)
            self._draw(client)
            self._keep(client, [curve])
            from relight.served import log_network

            log_network(client, self.id, network)

        self._attempt(send)

    def add(self, values: Mapping[str, float], *files: Path) -> None:
        """Writes figures about the finished training, those that are new; the run's end stays that of the training."""

        def send(client) -> None:
            from mlflow.entities import Metric

            run, when = client.get_run(self.id), milliseconds()
            models = run.outputs.model_outputs if run.outputs else []
            model = models[0].model_id if models else None
            client.log_batch(
                self.id,
                metrics=[
                    Metric(name, value, when, 0, model_id=model)
                    for name, value in values.items()
                    if run.data.metrics.get(name) != value
                ],
            )
            self._end(client)
            self._keep(client, files)

        self._attempt(send)

    def fail(self) -> None:
        """Marks the run as failed, where there is one."""
        if self.id:
            self._attempt(lambda client: self._end(client, "FAILED"))


@contextmanager
def tracked(
    track: Track, name: str, fingerprint: str, settings: dict, data: Mapping[str, Path] | None = None
) -> Iterator[Training]:
    """The run of a training; it is marked as failed when the block is left by an exception."""
    run = Training(track, name, fingerprint, settings, data)
    try:
        yield run
    except BaseException:
        run.fail()
        raise


def overall(flow: Workflow) -> Run:
    """The run of a whole workflow."""
    return Run(flow.track, flow.name, flow.fingerprint, flow.settings, flow.tags, start=flow.start)


def conclude(flow: Workflow, networks: Mapping[str, Path], folder: Path, failed: bool = False) -> None:
    """Ends the run of a workflow: what came out as its artifacts and description, its best network registered.

    networks: the files of its trainings, by name; folder: of its report. Of a workflow that `failed` it notes that; one
    that ended before its first training has no run.
    """
    if failed and not (folder.parent / "train").exists():
        return
    from safetensors import safe_open

    run = overall(flow)

    def fingerprint(path: Path) -> str:
        with safe_open(path, "np") as file:
            return json.loads(file.metadata()["relight"]).get("fingerprint", "")

    def send(client) -> None:
        if failed:
            return run._end(client, "FAILED")
        experiment, trained = client.get_run(run.id).info.experiment_id, {}
        for name, path in networks.items():
            if Path(path).exists():
                found = client.search_runs([experiment], f"tags.fingerprint = '{fingerprint(path)}'")
                trained |= {one.info.run_name: one for one in found if one.info.run_name == name}
        client.set_tag(run.id, "mlflow.note.content", described(flow, trained))
        shown = (".html", ".csv", ".md", ".tex", ".png")
        run._keep(client, [folder.parent / "run.yaml"])
        for file in sorted(folder.glob("*")):
            if file.suffix in shown and file.stat().st_size < LARGEST:
                client.log_artifact(run.id, str(file), "report")
        best = min(
            (one for one in trained.values() if SCORE in one.data.metrics),
            key=lambda one: one.data.metrics[SCORE],
            default=None,
        )
        if best:
            client.set_tag(run.id, "best", best.info.run_name)
            client.log_metric(run.id, f"best.{SCORE}", best.data.metrics[SCORE])
            register(client, best)
        run._end(client)

    run._attempt(send)


def described(flow: Workflow, trained: Mapping[str, object]) -> str:
    """The description of a workflow's run, in Markdown: its trainings by experiment, with links."""
    lines = [f"The workflow of `results/{flow.name}`. Its tables, pictures and report are among the artifacts."]
    ids = {name: (one.info.experiment_id, one.info.run_id) for name, one in trained.items()}
    if len(ids) > 1:
        runs, (experiment, _) = (
            json.dumps([run for _, run in ids.values()], separators=(",", ":")),
            next(iter(ids.values())),
        )
        lines.append(f"[Compare them](#/compare-runs?runs={runs}&experiments=[%22{experiment}%22])".replace('"', "%22"))
    for experiment in dict.fromkeys(name for names in flow.rows.values() for name in names):
        shown = {name: one for name, one in trained.items() if experiment in flow.rows.get(one.data.tags["row"], [])}
        if shown:
            lines += [f"### {experiment}", f"| training | {SCORE} |\n|---|---|"]
            lines[-1] += "".join(
                f"\n| [{name}](#/experiments/{ids[name][0]}/runs/{ids[name][1]}) "
                f"| {one.data.metrics.get(SCORE, float('nan')):.4f} |"
                for name, one in shown.items()
            )
    return "\n\n".join(lines)


def register(client, run) -> None:
    """Makes the network of a run the newest version of the registered model, under the alias of its colour model.

    `models:/relight@photo` is then the best network of the last workflow that trained for photographs,
    `models:/relight@paper` that of the last one in the paper's colours.
    """
    from mlflow.exceptions import MlflowException

    models = run.outputs.model_outputs if run.outputs else []
    if not models:
        return
    source = f"models:/{models[0].model_id}"
    with suppress(MlflowException):  # it is there
        client.create_registered_model(MODEL, description="Networks of relight, the best of each workflow.")
    versions = client.search_model_versions(f"name = '{MODEL}' and run_id = '{run.info.run_id}'")
    version = versions[0] if versions else client.create_model_version(MODEL, source, run.info.run_id)
    client.set_registered_model_alias(MODEL, run.data.params["train.color"], version.version)


def browse(track: Track, port: int) -> None:
    """Becomes MLflow's server on this machine, and says where the runs are; of runs on a server just the latter.

    One worker is enough for a person; nothing is computed for language models. Raises UserError when nothing is
    tracked.
    """
    from mlflow import MlflowClient

    if not track.uri:
        raise UserError("track.uri is null: nothing is recorded in MLflow")
    os.chdir(ROOT)
    with alone():
        create(track.uri)
        experiment = identify(MlflowClient(track.uri), track)
    server = track.uri.rstrip("/") if track.uri.startswith("http") else f"http://127.0.0.1:{port}"
    print(f"MLflow: {server}/#/experiments/{experiment}/runs{RUNS}", flush=True)
    if server.startswith(track.uri.rstrip("/")):
        return
    os.environ |= {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_LOGGING_LEVEL": "WARNING"}
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", track.uri, "--workers", "1"]
    os.execv(sys.executable, [*command, "--host", "127.0.0.1", "--port", str(port)])


def downloaded(uri: str) -> Path:
    """The network (.safetensors) of a model in MLflow, such as models:/relight@photo.

    It is looked for at MLFLOW_TRACKING_URI, else where this repository tracks its runs. Raises UserError when it is not
    there.
    """
    address = os.environ.get("MLFLOW_TRACKING_URI") or composed().track.uri
    try:
        import mlflow

        with chdir(ROOT):
            if not address or (address.startswith("sqlite:///") and not Path(address[10:]).exists()):
                raise FileNotFoundError(f"there is no store {address}")
            folder = Path(mlflow.artifacts.download_artifacts(uri, tracking_uri=address)).resolve()
        return next(folder.rglob("*.safetensors"))
    except Exception as error:  # MLflow raises what its stores raise
        reason = str(error).strip().split("\n")[0] or "it holds no network of relight"
        raise UserError(f"{uri} is not in MLflow ({address}): {reason}") from None


def listed(client, run: str, folder: str) -> list:
    """The artifacts in a folder of a run; none where there is no such folder."""
    return [item for item in client.list_artifacts(run, folder) if "+step+" in item.path]


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
    made = client.create_experiment(track.experiment, tags=KIND)
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

        with (
            tempfile.TemporaryDirectory() as folder,
            atomic_write(path) as tmp,
        ):  # SQLite leaves its journal there
            SqlAlchemyStore(f"sqlite:///{folder}/new.db", str(Path(ARTIFACTS).resolve()))
            shutil.copyfile(f"{folder}/new.db", tmp)
    if path.is_absolute():
        return
    own = f"'{ARTIFACTS}/' || experiment_id"
    with closing(sqlite3.connect(path, timeout=PATIENCE)) as store, store:
        for table, column, place in (
            ("experiments", "artifact_location", own),
            ("runs", "artifact_uri", f"{own} || '/' || run_uuid || '/artifacts'"),
            ("logged_models", "artifact_location", f"{own} || '/models/' || model_id || '/artifacts'"),
        ):
            store.execute(f"UPDATE {table} SET {column} = {place} WHERE {column} LIKE '%/' || {place}")
