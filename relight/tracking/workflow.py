"""What a workflow tells its stages about itself, and what MLflow keeps of one that has ended."""

import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from relight.config import Track

WORKFLOW = "RELIGHT_WORKFLOW"  # in a stage's environment: the Workflow that it works for, as JSON
MODEL = "relight"  # the registered model
SCORE = "test/shading_rmse"  # by which the best network of a workflow is chosen
KEPT = (".html", ".csv", ".md", ".tex", ".png")  # files of the report that become artifacts
MAX_BYTES = 32 << 20  # of each
VIEW = "workflowType=machine_learning"  # of MLflow's pages, whose other view is of language models


@dataclass(frozen=True)
class Workflow:
    """A workflow, as its stages and MLflow know it.

    Attributes:
        track: where it is recorded.
        name: of its results.
        fingerprint: a hash of its settings.
        settings: its parameters, nested.
        rows: each row with the experiments that compare it.
        tags: of its run and of those of its trainings.
        start: when it began, in ms since 1970.
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
        """The workflow that this process is a stage of, if any."""
        if not (text := os.environ.get(WORKFLOW)):
            return None
        fields = json.loads(text)
        return Workflow(**{**fields, "track": Track(**fields["track"])})

    def to_json(self) -> str:
        """For the environment of the stages."""
        return json.dumps(asdict(self))


def milliseconds() -> int:
    """The time in ms since 1970, as MLflow stores it."""
    return int(1000 * time.time())


def finish_workflow(workflow: Workflow, networks: Mapping[str, Path | str], report: Path, failed: bool = False) -> None:
    """Ends the run of a workflow; adds its report as artifacts, a description, and registers its best network.

    Args:
        workflow: what ended.
        networks: the files of its trainings, by name.
        report: the folder of its report.
        failed: only this is recorded then; one that ended before its first training has no run.
    """
    if failed and not (report.parent / "train").exists():
        return
    from relight.tracking.run import workflow_run

    run = workflow_run(workflow)

    def send() -> None:
        if failed:
            return run.end("FAILED")
        trained = find_trainings(run.client, run.client.get_run(run.id).info.experiment_id, networks)
        run.client.set_tag(run.id, "mlflow.note.content", description(workflow, trained))
        run.log_settings()
        run.log_files([report.parent / "run.yaml"])
        files = [file for file in sorted(report.glob("*")) if file.suffix in KEPT]
        run.log_files([file for file in files if file.stat().st_size < MAX_BYTES], "report")
        scored = [one for one in trained.values() if SCORE in one.data.metrics]
        if scored:
            best = min(scored, key=lambda one: one.data.metrics[SCORE])
            run.client.set_tag(run.id, "best", best.info.run_name)
            run.client.log_metric(run.id, f"best.{SCORE}", best.data.metrics[SCORE])
            register(run.client, best)
        run.end()

    run.attempt(send)


def find_trainings(client, experiment: str, networks: Mapping[str, Path | str]) -> dict:
    """The runs of networks, by the names and the fingerprints that the networks' files hold.

    Args:
        client: an `MlflowClient`.
        experiment: the id of their experiment.
        networks: files (.safetensors) by name; those that do not exist are passed over.

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
    """The description of a workflow's run, in Markdown: its trainings by experiment, with links.

    Args:
        workflow: its rows name the experiments.
        trained: as from `find_trainings`.
    """
    lines = [f"The workflow of `results/{workflow.name}`. Its tables, pictures and report are among the artifacts."]
    if len(trained) > 1:
        runs = json.dumps([one.info.run_id for one in trained.values()], separators=(",", ":"))
        experiment = next(iter(trained.values())).info.experiment_id
        link = f'#/compare-runs?runs={runs}&experiments=["{experiment}"]&{VIEW}'.replace('"', "%22")
        lines.append(f"[Compare them]({link})")
    for experiment in dict.fromkeys(name for names in workflow.rows.values() for name in names):
        shown = {n: one for n, one in trained.items() if experiment in workflow.rows.get(one.data.tags["row"], [])}
        if shown:
            table = [f"| training | {SCORE} |", "|---|---|"]
            for name, one in shown.items():
                link = f"#/experiments/{one.info.experiment_id}/runs/{one.info.run_id}?{VIEW}"
                table.append(f"| [{name}]({link}) | {one.data.metrics.get(SCORE, float('nan')):.4f} |")
            lines += [f"### {experiment}", "\n".join(table)]
    return "\n\n".join(lines)


def register(client, run) -> None:
    """Makes the network of a run the newest version of the registered model, under the alias of its colour model.

    `models:/relight@photo` is then the best network of the last workflow that trained for photographs,
    `models:/relight@paper` that of the last one in the paper's colours.

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
