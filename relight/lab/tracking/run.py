"""The run of a training in MLflow."""

import csv
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.files import file_hash
from relight.core.version import __version__
from relight.lab.tracking.store import connect
from relight.learning.training_name import COLORS, TrainingName
from relight.settings import Track, flat

NOTE = """\
Losses are means over the steps since the last point, and those of the validation over figures and lights that are \
left out of the training.

Scores (`test_`) are means over all test figures and lights; `scores` of the artifacts holds the others.

The columns of pictures: the picture, albedo, shading, a ball under the light, the figure under another light; the \
truth is above what is inferred.
"""
TOTAL = "loss/train"  # a metric of every step
RETRY_FACTOR = 100  # delay before a failed store is tried again, over the duration of the failure
HEADLINE = "_rmse"  # end of the scores that become metrics, of which MLflow draws a chart each


class TrainingRun:
    """The run of a training, found by name and fingerprint or created, with the machine's load.

    The fingerprint is a hash of everything on which the results depend. A training that is resumed continues its run;
    one with other settings or data has another run. Exceptions of MLflow become warnings. What a store misses while it
    cannot be reached, `finish` sends, except pictures. A run that has finished stays as it is.
    """

    def __init__(self, tracking: dict[str, Any], name: str, fingerprint: str, settings: dict):
        """Takes what the run records; nothing is sent before `open`.

        Args:
            tracking: `track`, store and experiment, and `tags` and overrides by row (`relight.lab.plan.Plan.tracking`).
            name: name of the training, such as ours_full.s0.
            fingerprint: `relight.learning.train.fingerprint`.
            settings: parameters of the run, nested.
        """
        training = TrainingName.parse(name)
        self.track = Track(**tracking["track"])
        self.name, self.fingerprint = name, fingerprint
        # With those that the row names, such as loss=min, since a comparison shows what differs.
        named = dict(word.lstrip("+").partition("=")[::2] for word in tracking["rows"].get(training.row, []))
        self.settings = {key: str(value) for key, value in (named | flat(settings)).items()}
        self.tags = {"row": training.row, "fingerprint": fingerprint, "relight.version": __version__}
        tags_by_row = tracking["tags"]
        self.tags |= {"seed": str(training.seed), **tags_by_row.get(training.row, {})}
        if training.row in tags_by_row:
            self.tags["mlflow.runColor"] = COLORS[list(tags_by_row).index(training.row) % len(COLORS)]
        self.id = ""  # until it is open
        self.is_finished = False
        self._warnings: set[str] = set()
        self._retry_at = 0.0

    def open(self) -> None:
        """Finds or creates the run, with its parameters, as MLflow's active one unless it has finished."""
        if self.id:
            return
        client, experiment = connect(self.track)
        import mlflow

        runs = client.search_runs([experiment], f"tags.fingerprint = '{self.fingerprint}'")
        run: Any = next((found for found in runs if found.info.run_name == self.name), None)
        self.is_finished = run is not None and run.info.status == "FINISHED"
        if not self.is_finished:
            known = {"run_id": run.info.run_id} if run else {"experiment_id": experiment, "run_name": self.name}
            mlflow.end_run("FAILED")  # that of an earlier attempt
            run = mlflow.start_run(**known, tags=self.tags, description=NOTE, log_system_metrics=True)
            mlflow.log_params(self.settings)
        self.id = run.info.run_id

    def log(self, values: Mapping[str, float], step: int, image: np.ndarray | None = None) -> None:
        """Sends the values of a step, named as in the training's curve, and an image (H,W,3) uint8."""
        if time.monotonic() > self._retry_at:
            with self.warned():
                self._send({step: values}, image)

    def finish(self, network: Path, curve: Path | None = None) -> None:
        """Sends what the store lacks, adds the network's file, and ends the run.

        Args:
            network: file (.safetensors).
            curve: the values of all steps (.csv).
        """
        with self.warned():
            self.open()
            if self.is_finished:
                return
            import mlflow

            with self.warned():
                if curve:
                    self._send(read_curve(curve))
                    mlflow.log_artifact(str(curve), "curve")
                mlflow.log_artifact(str(network), "network")
            mlflow.end_run()

    @contextmanager
    def warned(self) -> Iterator[None]:
        """Turns exceptions into warnings, one for each reason, since MLflow must never end a training."""
        began = time.monotonic()
        try:
            yield
        except Exception as error:  # of any kind: MLflow raises those of its stores
            reason = str(error).strip().split("\n")[0]
            if reason not in self._warnings:
                print(f"{self.name} is not recorded in MLflow ({self.track.uri}): {reason}", file=sys.stderr)
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
        from mlflow.entities import Metric

        client = mlflow.MlflowClient()
        sent = {point.step for point in client.get_metric_history(self.id, TOTAL)}
        for step, values in steps.items():
            if step in sent:
                continue
            milliseconds = int(1000 * time.time())
            metrics = [Metric(metric_name(name), value, milliseconds, step) for name, value in values.items()]
            client.log_batch(self.id, metrics)
            if image is not None:
                client.log_image(self.id, image, key="validation", step=step, synchronous=True)


def metric_name(name: str) -> str:
    """Returns the name in MLflow, group/value, of a column of a training's curve, [validation/]value.

    MLflow draws a chart for each group, in alphabetical order, so both losses come first.

    >>> [metric_name(name) for name in ("loss", "validation/loss", "albedo", "validation/albedo")]
    ['loss/train', 'loss/validation', 'train/albedo', 'validation/albedo']
    """
    group, _, value = name.rpartition("/")
    group = group or "train"
    return f"loss/{group}" if value == "loss" else f"{group}/{value}"


def read_curve(path: Path) -> dict[int, dict[str, float]]:
    """Reads the values of all steps of a training from its curve (.csv), without blanks."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return {int(row.pop("step")): {name: float(value) for name, value in row.items() if value} for row in rows}


@contextmanager
def training_run(tracking: dict[str, Any], name: str, fingerprint: str, settings: dict) -> Iterator[TrainingRun | None]:
    """Yields the open run of a training, and marks it as failed if the block raises.

    Args:
        tracking: as for `TrainingRun`. Without an address nothing is tracked, and None is yielded.
        name: name of the training, such as ours_full.s0.
        fingerprint: hash of everything on which the results depend (`relight.learning.train.fingerprint`).
        settings: parameters of the run, nested.
    """
    run = TrainingRun(tracking, name, fingerprint, settings)
    if not run.track.uri:
        yield None
        return
    with run.warned():
        run.open()
    try:
        yield run
    except BaseException:
        with run.warned():
            import mlflow

            mlflow.end_run("FAILED")
        raise


def log_scores(
    tracking: dict[str, Any], network: Path, config: dict, condition: str, means: Mapping[str, float], scores: Path
) -> None:
    """Adds the scores of a network to the run of its training, which is made if the store lacks it.

    Args:
        tracking: as for `TrainingRun`.
        network: file (.safetensors).
        config: its header, as from `relight.learning.checkpoint.read_config`.
        condition: what was scored: `test`, whose RMSE become metrics, or others such as `sitting-test`.
        means: by name.
        scores: file of all scores.
    """
    settings = {part: config[part] for part in ("model", "loss", "train", "augment") if part in config}
    # A network without a fingerprint was trained elsewhere, and has its own run.
    fingerprint = config.get("fingerprint") or file_hash(network)
    training = TrainingRun(tracking, network.stem, fingerprint, settings)
    if not training.track.uri:
        return
    training.finish(network)  # makes the run of a network that was trained without the store; else does nothing
    with training.warned():
        from mlflow import MlflowClient
        from mlflow.entities import Metric

        training.open()
        client, milliseconds = MlflowClient(), int(1000 * time.time())
        run = client.get_run(training.id)
        names = [name for name in means if name.endswith(HEADLINE) and condition == "test"]
        headline = {f"test_{name}": means[name] for name in names}
        new = {name: value for name, value in headline.items() if run.data.metrics.get(name) != value}
        metrics = [Metric(name, value, milliseconds, step=0) for name, value in new.items()]
        client.log_batch(training.id, metrics)
        table = "\n".join(["score,mean", *(f"{name},{value:.6g}" for name, value in means.items()), ""])
        client.log_text(training.id, table, f"scores/{condition}/means.csv")
        client.log_artifact(training.id, str(scores), f"scores/{condition}")
