"""The run of a training in MLflow."""

import hashlib
import signal
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.files import file_hash
from relight.core.text import without_passwords
from relight.core.version import __version__
from relight.lab.tracking.store import connect
from relight.learning.checkpoint import load_network, read_config
from relight.learning.training_name import COLORS, TrainingName
from relight.settings import Track, flat

NOTE = """\
Losses are means over the steps since the last point, and those of the validation over figures and lights that are \
left out of the training.

Scores (`test_`) are means over all test figures and lights; `scores` of the artifacts holds the others.

The columns of pictures: the picture, albedo, shading, a ball under the light, the figure under another light; the \
truth is above what is inferred.
"""
Settings = dict[str, Any]  # nested
RETRY_FACTOR = 100  # delay before a failed store is tried again, over the duration of the failure


class TrainingRun:
    """The run of a training, found by name and fingerprint or created, with the machine's load.

    The fingerprint is a hash of everything on which the results depend. A training that is resumed continues its run;
    one with other settings or data has another run. Exceptions of MLflow become warnings. What a store misses while it
    cannot be reached, `finish` sends, except pictures. A run that has finished stays as it is.
    """

    def __init__(self, tracking: Settings, name: str, fingerprint: str, settings: Settings):
        """Takes what the run records; nothing is sent before `open`.

        Args:
            tracking: `track`, store and experiment, `tags`, and overrides by row (`relight.lab.plan.Plan.tracking`),
                and `datasets`, if known, as MLflow describes them.
            name: name of the training, such as ours_full.s0.
            fingerprint: `relight.learning.train.fingerprint`.
            settings: parameters of the run, nested.
        """
        training, rows = TrainingName.parse(name), tracking["rows"]
        self.track = Track(**tracking["track"])
        self.name, self.fingerprint = name, fingerprint
        # With those that the row names, such as loss=min, since a comparison shows what differs.
        named = dict(word.lstrip("+").partition("=")[::2] for word in rows.get(training.row, []))
        self.settings = {key: str(value) for key, value in (named | flat(settings)).items()}
        self.datasets = tracking.get("datasets", [])
        self.tags = {**tracking["tags"], "fingerprint": fingerprint, "relight.version": __version__}
        if training.row in rows:
            color = COLORS[list(rows).index(training.row) % len(COLORS)]
            self.tags |= {"row": training.row, "seed": str(training.seed), "mlflow.runColor": color}
        self.id, self.is_finished = "", False  # until it is open
        self._warnings: set[str] = set()
        self._retry_at = 0.0

    def open(self, note: str = NOTE) -> None:
        """Finds or creates the run, with its parameters, as MLflow's active one unless it has finished.

        An earlier one of other settings or data, which it replaces in the results, is renamed and, if killed, ended.
        """
        if self.id:
            return
        client, experiment = connect(self.track)
        import mlflow
        from mlflow.entities import Dataset, DatasetInput

        runs = client.search_runs([experiment], f"attributes.run_name = '{self.name}'")
        run: Any = next((found for found in runs if found.data.tags.get("fingerprint") == self.fingerprint), None)
        for old in () if run else runs:
            if self.is_of_workflow(old):
                client.update_run(old.info.run_id, {"RUNNING": "KILLED"}.get(old.info.status), f"{self.name} (earlier)")
        self.is_finished = run is not None and run.info.status == "FINISHED"
        if not self.is_finished:
            known = {"run_id": run.info.run_id} if run else {"experiment_id": experiment, "run_name": self.name}
            mlflow.end_run("FAILED")  # that of an earlier attempt
            run = mlflow.start_run(**known, tags=self.tags, description=note, log_system_metrics=bool(self.settings))
            mlflow.log_params(self.settings)
            client.log_inputs(run.info.run_id, [DatasetInput(Dataset(**data)) for data in self.datasets])
        self.id = run.info.run_id

    def is_of_workflow(self, run: Any) -> bool:
        """Returns whether another run is of the same workflow in the same clone."""
        return all(run.data.tags.get(key) == self.tags.get(key) for key in ("workflow", "clone"))

    def log(self, values: Mapping[str, float], step: int, image: np.ndarray | None = None) -> None:
        """Sends the values of a step, named as in the training's curve, and an image (H,W,3) uint8."""
        if time.monotonic() > self._retry_at:
            with self.warned():
                self._send({step: values}, image)

    def finish(self, network: Path, curve: Path | None = None) -> None:
        """Sends what the store lacks by the `curve` (.csv), adds the network (.safetensors), and ends the run."""
        with self.warned():
            self.open()
            if self.is_finished:
                return
            import mlflow
            import pandas as pd

            with self.warned():
                if curve:
                    steps = pd.read_csv(curve, index_col="step").iterrows()
                    self._send({int(step): values.dropna() for step, values in steps})
                    mlflow.log_artifact(str(curve), "curve")
                with self.warned(f"MLflow has no model of {self.name}, whose network is {network}"):
                    log_network(self.id, network)
            mlflow.end_run()

    @contextmanager
    def warned(self, what: str = "") -> Iterator[None]:
        """Turns exceptions into warnings, one for each reason, since MLflow must never end a training."""
        what = what or f"{self.name} is not recorded in MLflow ({without_passwords(str(self.track.uri))})"
        began = time.monotonic()
        try:
            yield
        except Exception as error:  # of any kind: MLflow raises those of its stores
            if (reason := str(error).strip().split("\n")[0]) not in self._warnings:
                print(f"{what}: {reason}", file=sys.stderr)
            self._warnings.add(reason)
            # A store that cannot be reached takes long to fail: `log` waits, so that it costs little of the training.
            self._retry_at = time.monotonic() + RETRY_FACTOR * (time.monotonic() - began)

    def _send(self, steps: Mapping[int, Mapping[str, float]], image: np.ndarray | None = None) -> None:
        """Sends the values of the steps that the store lacks, and an image of a single one.

        A training that was killed logs the steps since its last state again. `steps` has the values of each step by
        column of the curve.
        """
        self.open()
        if self.is_finished:
            return
        import mlflow

        sent = {point.step for point in mlflow.MlflowClient().get_metric_history(self.id, "loss/train")}
        for step in sorted(steps.keys() - sent):
            mlflow.log_metrics({metric_name(name): value for name, value in steps[step].items()}, step, run_id=self.id)
            if image is not None:
                mlflow.log_image(image, key="validation", step=step, synchronous=True)


def metric_name(name: str) -> str:
    """Returns the name in MLflow, group/value, of a column of a training's curve, [validation/]value.

    MLflow draws a chart for each group, in alphabetical order, so both losses come first.

    >>> [metric_name(name) for name in ("loss", "validation/loss", "albedo", "validation/albedo")]
    ['loss/train', 'loss/validation', 'train/albedo', 'validation/albedo']
    """
    group, _, value = name.rpartition("/")
    group = group or "train"
    return f"loss/{group}" if value == "loss" else f"{group}/{value}"


def log_network(run: str, network: Path) -> None:
    """Adds a network (.safetensors) to a run as its model `network`, which needs no code of relight: its graph.

    An earlier one goes, of a training that was killed before the run ended.
    """
    import mlflow.onnx
    import onnx
    from mlflow.models import ModelSignature
    from mlflow.types import Schema, TensorSpec

    from relight.learning.export import export, sample_inputs, smallest_side
    from relight.photos.network import INPUTS

    def schema(values: Iterable[Any]) -> Schema:
        shapes = {value.name: value.type.tensor_type.shape.dim for value in values}
        return Schema(
            [TensorSpec(np.dtype("f4"), [size.dim_value or -1 for size in shapes[name]], name) for name in shapes]
        )

    loaded, config = load_network(network)
    side = smallest_side(loaded)
    with tempfile.TemporaryDirectory() as folder:
        export(loaded, f"{folder}/network.onnx", config)
        model = onnx.load(f"{folder}/network.onnx")
    client = mlflow.MlflowClient()
    for old in client.search_logged_models([client.get_run(run).info.experiment_id], f"source_run_id = '{run}'"):
        client.delete_logged_model(old.model_id)
    mlflow.onnx.log_model(
        model,
        name="network",
        signature=ModelSignature(schema(model.graph.input), schema(model.graph.output)),
        input_example=dict(zip(INPUTS, (values.numpy() for values in sample_inputs(1, side, side)))),
        pip_requirements=mlflow.onnx.get_default_pip_requirements(),
        onnx_execution_providers=["CPUExecutionProvider"],
        save_as_external_data=False,
        extra_files=[str(network)],
    )


@contextmanager
def training_run(tracking: Settings, name: str, fingerprint: str, settings: Settings) -> Iterator[TrainingRun | None]:
    """Yields the open run of a training, and marks it as failed if the block raises, or as killed by SIGTERM.

    Args:
        tracking, name, fingerprint, settings: as for `TrainingRun`; without an address None is yielded.
    """
    run = TrainingRun(tracking, name, fingerprint, settings)
    if not run.track.uri:
        yield None
        return
    with run.warned():
        run.open()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as of a Snakemake that ends
    try:
        yield run
    except BaseException as error:
        with run.warned():
            import mlflow

            mlflow.end_run("KILLED" if isinstance(error, KeyboardInterrupt) else "FAILED")
        raise


def run_of(tracking: Settings, network: Path) -> TrainingRun:
    """Returns the run of the training of a network (.safetensors); `finish` makes it if the store lacks it."""
    config = read_config(network)
    settings: Settings = {part: config[part] for part in ("model", "loss", "train", "augment") if part in config}
    # A network without a fingerprint was trained elsewhere, and has its own run.
    return TrainingRun(tracking, network.stem, config.get("fingerprint") or file_hash(network), settings)


def log_report(tracking: Settings, networks: Iterable[Path], files: Iterable[Path], record: Path) -> None:
    """Records a report, its page and tables, in a run of its own, whose children are the runs of its trainings.

    `tracking` is as for `TrainingRun`; of `record` (run.yaml) no password is sent.
    """
    if not tracking["track"]["uri"]:
        return
    trainings = {network: run_of(tracking, network) for network in networks}
    fingerprint = hashlib.sha256(repr(sorted(one.fingerprint for one in trainings.values())).encode()).hexdigest()
    report = TrainingRun(tracking, f"report of {tracking['tags']['workflow']}", fingerprint, {})
    with report.warned():
        report.open("Compares the trainings below this run: `report.html` among the artifacts, and its tables.")
        import mlflow

        for file in files:
            mlflow.log_artifact(str(file), run_id=report.id)
        client = mlflow.MlflowClient()
        client.log_text(report.id, without_passwords(record.read_text()), "run.yaml")
        mlflow.end_run()
        for left in client.search_runs([client.get_run(report.id).info.experiment_id], "status = 'RUNNING'"):
            if report.is_of_workflow(left):  # of trainings that were killed, and that nobody asks for any more
                client.set_terminated(left.info.run_id, "KILLED")
        for network, training in trainings.items():
            training.finish(network)
            client.set_tag(training.id, "mlflow.parentRunId", report.id)


def log_scores(tracking: Settings, network: Path, condition: str, scores: Path) -> None:
    """Adds the scores (.csv) of a network to the run of its training, which is made if the store lacks it.

    `tracking` is as for `TrainingRun`, and `condition` what was scored: `test`, whose mean RMSE become metrics, or
    others such as `sitting-test`.
    """
    if not tracking["track"]["uri"]:
        return
    training = run_of(tracking, network)
    training.finish(network)
    with training.warned():
        import mlflow
        import pandas as pd

        training.open()
        if condition == "test":
            rmse = pd.read_csv(scores).filter(regex="_rmse$").mean(skipna=False).dropna().add_prefix("test_").to_dict()
            known = mlflow.get_run(training.id).data.metrics.items()  # of a job that was killed, or scores again
            mlflow.log_metrics(dict(rmse.items() - known), step=0, run_id=training.id)
        mlflow.log_artifact(str(scores), f"scores/{condition}", run_id=training.id)
