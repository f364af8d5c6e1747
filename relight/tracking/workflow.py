"""Passes the record of a workflow to its stages, and completes its run in MLflow."""

import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from relight.config import Track

WORKFLOW = "RELIGHT_WORKFLOW"  # environment variable of stages: their Workflow as JSON
MODEL = "relight"  # the registered model
SCORE = "test/shading_rmse"  # metric by which the best network of a workflow is selected
ARTIFACT_SUFFIXES = (".html", ".csv", ".md", ".tex", ".png")  # of the report's files that become artifacts
MAX_ARTIFACT_BYTES = 32 << 20  # per file
VIEW = "workflowType=machine_learning"  # of MLflow's pages; the other view is for language models


@dataclass(frozen=True)
class Workflow:
    """The record of a workflow for its stages and MLflow.

    Attributes:
        track: store and experiment.
        name: of its results.
        fingerprint: hash of its settings.
        settings: parameters, nested.
        rows: row -> experiments that compare it.
        tags: of its run and of those of its trainings.
        start: time of its start, ms since 1970.
    """

    track: Track
    name: str
    fingerprint: str
    settings: dict
    rows: dict[str, list[str]]
    tags: dict[str, str] = field(default_factory=dict)
    start: int = 0

    @staticmethod
    def from_environment() -> "Workflow | None":
        """Returns the workflow of which this process is a stage, if any."""
        if not (text := os.environ.get(WORKFLOW)):
            return None
        fields = json.loads(text)
        return Workflow(**{**fields, "track": Track(**fields["track"])})

    def to_json(self) -> str:
        """Returns the record for the environment of the stages."""
        return json.dumps(asdict(self))


def milliseconds() -> int:
    """Returns the time in ms since 1970, the unit of MLflow."""
    return int(1000 * time.time())


def finish_workflow(workflow: Workflow, networks: Mapping[str, Path | str], report: Path, failed: bool = False) -> None:
    """Ends the run of a workflow: adds its report as artifacts and a description, and registers its best network.

    Args:
        workflow: that ended.
        networks: files of its trainings, by name.
        report: folder of its report.
        failed: whether it failed; then only the status is set, if there is a run.
    """
    if failed and not (report.parent / "train").exists():  # nothing was trained, so there is no run
        return
    from relight.tracking.run import workflow_run

    run = workflow_run(workflow)
    if failed:
        return run.fail()

    def send() -> None:
        trained = find_trainings(run.client, run.client.get_run(run.id).info.experiment_id, networks)
        run.client.set_tag(run.id, "mlflow.note.content", description(workflow, trained))
        run.log_settings()
        run.log_files([report.parent / "run.yaml"])
        files = [file for file in sorted(report.glob("*")) if file.suffix in ARTIFACT_SUFFIXES]
        run.log_files([file for file in files if file.stat().st_size < MAX_ARTIFACT_BYTES], "report")
        candidates = [training for training in trained.values() if can_be_best(training)]
        if candidates:
            best = min(candidates, key=lambda training: training.data.metrics[SCORE])
            run.client.set_tag(run.id, "best", best.info.run_name)
            run.client.log_metric(run.id, f"best.{SCORE}", best.data.metrics[SCORE])
            register(run.client, best)
        run.end()

    run.attempt(send)


def can_be_best(training) -> bool:
    """Returns whether a training may be registered: it infers all that relighting needs, and saw no test data.

    Args:
        training: its run (`mlflow.entities.Run`).
    """
    params, metrics = training.data.params, training.data.metrics
    infers_all = all(score in metrics for score in (SCORE, "test/albedo_rmse", "test/light_rmse"))
    return infers_all and params.get("train.part") == "train" and "test" not in params.get("train.lights", "")


def find_trainings(client, experiment: str, networks: Mapping[str, Path | str]) -> dict:
    """Finds the runs of networks, by the names and the fingerprints in the networks' files.

    Args:
        client: an `MlflowClient`.
        experiment: the id of their experiment.
        networks: files (.safetensors) by name; missing ones are skipped.

    Returns:
        name -> `mlflow.entities.Run`.
    """
    from safetensors import safe_open

    found = {}
    for name, path in networks.items():
        if Path(path).exists():
            with safe_open(path, "np") as file:
                fingerprint = json.loads(file.metadata()["relight"]).get("fingerprint", "")
            runs = client.search_runs([experiment], f"tags.fingerprint = '{fingerprint}'")
            if run := next((run for run in runs if run.info.run_name == name), None):
                found[name] = run
    return found


def description(workflow: Workflow, trained: Mapping) -> str:
    """Returns the description of a workflow's run in Markdown: its trainings by experiment, with links.

    Args:
        workflow: its rows name the experiments.
        trained: runs of `find_trainings`.
    """
    lines = [f"The workflow of `results/{workflow.name}`. Its tables, pictures and report are among the artifacts."]
    if len(trained) > 1:
        runs = json.dumps([training.info.run_id for training in trained.values()], separators=(",", ":"))
        experiment = next(iter(trained.values())).info.experiment_id
        link = f'#/compare-runs?runs={runs}&experiments=["{experiment}"]&{VIEW}'.replace('"', "%22")
        lines.append(f"[Compare them]({link})")
    for experiment in dict.fromkeys(name for names in workflow.rows.values() for name in names):
        shown = {
            n: training
            for n, training in trained.items()
            if experiment in workflow.rows.get(training.data.tags["row"], [])
        }
        if shown:
            table = [f"| training | {SCORE} |", "|---|---|"]
            for name, training in shown.items():
                link = f"#/experiments/{training.info.experiment_id}/runs/{training.info.run_id}?{VIEW}"
                table.append(f"| [{name}]({link}) | {training.data.metrics.get(SCORE, float('nan')):.4f} |")
            lines += [f"### {experiment}", "\n".join(table)]
    return "\n\n".join(lines)


def register(client, run) -> None:
    """Registers the network of a run as the newest version of the model, with its colour model as an alias.

    `models:/relight@photo` is then the best network of the last workflow with the colour model `photo`, and
    `models:/relight@paper` that of the last one with `paper`.

    Args:
        client: an `MlflowClient`.
        run: an `mlflow.entities.Run`.
    """
    from mlflow.exceptions import MlflowException

    models = run.outputs.model_outputs if run.outputs else []
    if not models:
        return
    source = f"models:/{models[0].model_id}"
    with suppress(MlflowException):  # it exists
        client.create_registered_model(MODEL, description="Networks of relight, the best of each workflow.")
    versions = client.search_model_versions(f"name = '{MODEL}' and run_id = '{run.info.run_id}'")
    version = versions[0] if versions else client.create_model_version(MODEL, source, run.info.run_id)
    client.set_registered_model_alias(MODEL, run.data.params["train.color"], version.version)
