"""Runs in MLflow: of a training, and of its workflow."""

import csv
import hashlib
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from relight import __version__
from relight.config import Track, flat
from relight.tracking.store import configure, connect, lock
from relight.tracking.workflow import Workflow, milliseconds
from relight.training_name import TrainingName

NOTE = """\
`loss` and its parts are means over the steps since the last point, `validation/` the same on a few fixed pairs of test
figures and test lights, `test/` the means over all of them (docs/evaluation.md). The columns of pictures are the
picture, the albedo, the shading, a ball under the light, and the figure under another light; the ground truth is above
the inferred ones. Only the registered model is selected by these metrics.
"""
RETRY_FACTOR = 100  # delay before a failed store is tried again, over the duration of the failure
MAX_PARAMS_PER_BATCH = 100  # limit of MLflow


class Run:
    """A run in MLflow, found by name and fingerprint, or created when something is first logged.

    The fingerprint is a hash of everything on which the results depend. A training that is resumed continues its run;
    one with other settings or data has another run. Exceptions of MLflow are printed once as a warning on stderr, and
    unsent data are sent again later. Without an address nothing is tracked.
    """

    def __init__(
        self,
        track: Track,
        name: str,
        fingerprint: str,
        settings: dict,
        tags: Mapping[str, str] | None = None,
        parent: "Run | None" = None,
        start: int = 0,
    ):
        """
        Args:
            track: store and experiment.
            name: of the run.
            fingerprint: see above.
            settings: parameters of the run, nested.
            tags: of the run.
            parent: run in which it is nested.
            start: time of its start, ms since 1970; by default now.
        """
        if track.uri:
            configure()
        self.track, self.name, self.fingerprint, self.settings = track, name, fingerprint, settings
        self.tags, self.parent, self.start = dict(tags or {}), parent, start or milliseconds()
        self.id: str | None = None
        self.status = ""
        self.opened = False  # whether it was ever found or created in the store
        self.warnings: set[str] = set()
        self._metrics: dict[int, tuple[int, Mapping[str, float]]] = {}  # unsent, by step: time and values
        self._images: dict[int, np.ndarray] = {}  # unsent, by step
        self._sent_metrics: set[int] = set()  # steps in the store
        self._sent_images: set[int] = set()
        self._retry_at = 0.0

    def log(self, values: Mapping[str, float], step: int) -> None:
        """Sends the metrics of a step, and the images added before."""
        self._metrics[step] = milliseconds(), values
        if time.monotonic() > self._retry_at:
            self.attempt(self._send)

    def _send(self) -> None:
        self._send_metrics()
        self._send_images()

    def add_image(self, image: np.ndarray, step: int) -> None:
        """Adds an image (H,W,3) uint8 of a step, which the next `log` sends."""
        self._images[step] = image

    def attempt(self, action: Callable[[], object], opened: bool = True) -> None:
        """Calls `action` with the run open, if wanted, as `self.client` and `self.id`; exceptions become warnings."""
        if not self.track.uri:
            return
        began = time.monotonic()
        try:
            if opened and not self.id:
                self._open()
            action()
        except Exception as error:  # of any kind, since no training must end because of it
            self.id = None  # the run is looked up again
            reason = str(error).strip().split("\n")[0]
            if reason not in self.warnings:
                print(f"{self.name} is not recorded in MLflow ({self.track.uri}): {reason}", file=sys.stderr)
            self.warnings.add(reason)
            self._retry_at = time.monotonic() + RETRY_FACTOR * (time.monotonic() - began)

    def end(self) -> None:
        """Ends the run, unless it has finished before; to be called in `attempt`."""
        if self.status != "FINISHED":
            self.client.set_terminated(self.id, "FINISHED")

    def fail(self) -> None:
        """Marks the run as failed, if there is one, even if an earlier call has finished it."""

        def send() -> None:
            client, experiment = connect(self.track)
            if run := self._find(client, experiment):
                client.set_terminated(run.info.run_id, "FAILED")

        self.attempt(send, opened=False)

    def log_settings(self) -> None:
        """Adds the settings to the artifacts as config.yaml; to be called in `attempt`."""
        self.client.log_dict(self.id, self.settings, "config.yaml")

    def log_files(self, files: Iterable[Path], folder: str | None = None) -> None:
        """Adds files to a folder of the artifacts; to be called in `attempt`."""
        for file in files:
            self.client.log_artifact(self.id, str(file), folder)

    def _open(self) -> None:
        self.client, experiment = connect(self.track)
        with lock():
            run = self.find_or_create(self.client, experiment)
        self.id, self.status, self.opened = run.info.run_id, run.info.status, True
        self._sent_metrics = {point.step for point in self.client.get_metric_history(self.id, "loss")}
        if self._images:  # a killed training may have sent the images of a step without its metrics
            sent = [item.path for item in self.client.list_artifacts(self.id, "images") if "+step+" in item.path]
            self._sent_images = {int(path.split("+step+")[1].split("+")[0]) for path in sent}

    def find_or_create(self, client, experiment: str):
        """Returns the run in MLflow, created if missing, with all parameters; to be called in `lock`.

        Args:
            client: an `MlflowClient`.
            experiment: the id of its experiment.

        Returns:
            An `mlflow.entities.Run`.
        """
        from mlflow.entities import Param
        from mlflow.tracking.context.registry import resolve_tags

        run = self._find(client, experiment)
        if run is None:
            tags = {**self.tags, "fingerprint": self.fingerprint, "relight.version": __version__}
            if self.parent:
                tags["mlflow.parentRunId"] = self.parent.find_or_create(client, experiment).info.run_id
            run = client.create_run(experiment, start_time=self.start, tags=resolve_tags(tags), run_name=self.name)
        elif run.info.status != "FINISHED":
            client.update_run(run.info.run_id, status="RUNNING")
        params = {key: str(value) for key, value in flat(self.settings).items()}
        new = [Param(key, value) for key, value in params.items() if key not in run.data.params]
        for first in range(0, len(new), MAX_PARAMS_PER_BATCH):
            client.log_batch(run.info.run_id, params=new[first : first + MAX_PARAMS_PER_BATCH])
        return run

    def _find(self, client, experiment: str):
        """Returns the run in MLflow, or None."""
        found = client.search_runs([experiment], f"tags.fingerprint = '{self.fingerprint}'")
        return next((run for run in found if run.info.run_name == self.name), None)

    def _send_metrics(self) -> None:
        from mlflow.entities import Metric

        for step, (when, values) in sorted(self._metrics.items()):
            if step not in self._sent_metrics:
                metrics = [Metric(name, value, when, step) for name, value in values.items()]
                self.client.log_batch(self.id, metrics=metrics)
            self._sent_metrics.add(step)
            del self._metrics[step]

    def _send_images(self) -> None:
        for step, image in sorted(self._images.items()):
            if step not in self._sent_images:
                self.client.log_image(self.id, image, key="validation", step=step, synchronous=True)
            self._sent_images.add(step)
            del self._images[step]


class TrainingRun(Run):
    """The run of a training, nested in that of its workflow, with its data as inputs and system metrics."""

    def __init__(
        self, track: Track, name: str, fingerprint: str, settings: dict, data: Mapping[str, Path] | None = None
    ):
        """
        Args:
            track: store and experiment; those of the workflow of this process have priority.
            name: of the training, such as ours_full.s0.
            fingerprint: `relight.learning.train.fingerprint`.
            settings: of the training, nested.
            data: input files by name.
        """
        workflow, training = Workflow.from_environment(), TrainingName.parse(name)
        tags = {"row": training.row} | ({} if training.seed is None else {"seed": str(training.seed)})
        if workflow:
            tags |= {**workflow.tags, "experiment": ", ".join(workflow.rows.get(training.row, []))}
            track = workflow.track
        tags["mlflow.note.content"] = NOTE
        super().__init__(track, name, fingerprint, settings, tags, workflow_run(workflow) if workflow else None)
        self.data = dict(data or {})
        self._monitors: list = []

    def log(self, values: Mapping[str, float], step: int) -> None:
        """Sends the losses of a step, and the system metrics since the last one."""
        super().log({**values, **self._machine_load()} if self.track.uri else values, step)

    def _machine_load(self) -> dict[str, float]:
        """Returns MLflow's system metrics since the last call."""
        try:
            if not self._monitors:
                from mlflow.system_metrics.metrics.cpu_monitor import CPUMonitor
                from mlflow.system_metrics.metrics.gpu_monitor import GPUMonitor

                self._monitors = [CPUMonitor()]
                with suppress(Exception):  # no NVIDIA GPU, or no library to query it
                    self._monitors.append(GPUMonitor())
            found: dict[str, float] = {}
            for monitor in self._monitors:
                monitor.collect_metrics()
                found |= {f"system/{name}": float(value) for name, value in monitor.aggregate_metrics().items()}
                monitor.clear_metrics()
            return found
        except Exception:  # a broken MLflow is reported when the losses are sent
            return {}

    def find_or_create(self, client, experiment: str):
        """Returns the run as `Run.find_or_create`, with the files of `data` as inputs, by SHA-256."""
        from mlflow.entities import Dataset, DatasetInput, InputTag

        run = super().find_or_create(client, experiment)
        if not run.inputs.dataset_inputs and self.data:
            inputs = []
            for name, path in self.data.items():
                with open(path, "rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                client.set_tag(run.info.run_id, f"data.{name}", digest)
                profile = json.dumps({"bytes": path.stat().st_size, "sha256": digest})
                # MLflow limits digests to 36 characters.
                dataset = Dataset(name, digest[:36], "local", json.dumps({"uri": str(path)}), profile=profile)
                inputs.append(DatasetInput(dataset, [InputTag("mlflow.data.context", "training")]))
            client.log_inputs(run.info.run_id, inputs)
        return run

    def finish(self, curve: Path, network: Path) -> None:
        """Sends the remaining metrics of the training, ends the run, and adds the network as a model.

        Args:
            curve: the losses of all steps (.csv).
            network: file (.safetensors).
        """
        from relight.tracking.model import log_network

        with open(curve, newline="") as file:
            for row in csv.DictReader(file):
                values = {name: float(value) for name, value in row.items() if name != "step" and value}
                self._metrics.setdefault(int(row["step"]), (milliseconds(), values))

        def send() -> None:
            self._send_metrics()
            self.end()
            self._send_images()
            self.log_settings()
            self.log_files([curve])
            assert self.id is not None  # `attempt` opened the run
            log_network(self.client, self.id, network)

        self.attempt(send)

    def log_scores(self, values: Mapping[str, float], network: Path, *files: Path) -> None:
        """Sends new scores of the finished training; the end time of the run stays that of the training.

        Args:
            values: the scores by name.
            network: file (.safetensors), added as a model if the training was killed after it had written the file.
            files: further artifacts.
        """
        from relight.tracking.model import log_network

        def send() -> None:
            from mlflow.entities import Metric

            assert self.id is not None  # `attempt` opened the run
            log_network(self.client, self.id, network)
            run, when = self.client.get_run(self.id), milliseconds()
            models = run.outputs.model_outputs if run.outputs else []
            model = models[0].model_id if models else None
            new = {name: value for name, value in values.items() if run.data.metrics.get(name) != value}
            metrics = [Metric(name, value, when, 0, model_id=model) for name, value in new.items()]
            self.client.log_batch(self.id, metrics=metrics)
            self.end()
            self.log_settings()
            self.log_files(files)

        self.attempt(send)


@contextmanager
def training_run(
    track: Track, name: str, fingerprint: str, settings: dict, data: Mapping[str, Path] | None = None
) -> Iterator[TrainingRun]:
    """Yields the run of a training (see TrainingRun), and marks it as failed if the block raises."""
    run = TrainingRun(track, name, fingerprint, settings, data)
    try:
        yield run
    except BaseException:
        if run.opened:
            run.fail()
        raise


def workflow_run(workflow: Workflow) -> Run:
    """Returns the parent run of a workflow's trainings."""
    return Run(
        workflow.track,
        workflow.name,
        workflow.fingerprint,
        workflow.settings,
        {**workflow.tags, "mlflow.source.name": "Snakefile"},  # instead of the stage that creates the run
        start=workflow.start,
    )
