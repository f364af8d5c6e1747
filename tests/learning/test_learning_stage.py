"""The stage that trains: no kill and no failure of MLflow loses a training, and its run in MLflow tells the truth."""

import csv
import hashlib
import json
import multiprocessing
import os
import shutil
import sqlite3
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import pytest
import yaml
from mlflow import MlflowClient
from safetensors import safe_open

from relight.config import Track, flat
from relight.files import UserError
from relight.stages.train import main as stage
from relight.tracking import store
from relight.tracking.run import TrainingRun
from relight.tracking.workflow import WORKFLOW, finish_workflow
from relight.workflow import Plan

OUT, CURVE, STATE = (Path("train") / name for name in ("one.s0.safetensors", "one.s0.csv", "state/one.s0/state.pt"))

pytestmark = pytest.mark.slow


class Training:
    """The stage in a folder of its own, with a database of its own, as a function of changed settings."""

    def __init__(self, world, model, loss, schedule, augment):
        self.settings = model, loss, schedule, augment
        self.paths = {name: world[name] for name in ("packed", "lights", "split")}
        self.database = Path(f"{Path.cwd().name}.db")  # MLflow keeps the connection to a name
        self.uri = f"sqlite:///{self.database}"

    def __call__(self, paths: dict | None = None, out: Path = OUT, **changes) -> None:
        model, loss, schedule, augment = self.settings
        track = Track(changes.pop("uri", self.uri), "test")
        groups = model(), loss(), schedule(**changes), augment()
        stage(*groups, track, **{**self.paths, **(paths or {})}, out=out, curve=out.with_suffix(".csv"))

    def killed(self, function: str, count: int) -> None:
        """The stage, as a job of Snakemake, in a process that ends by SIGKILL when `function` was called so often."""
        owner, name = function.rsplit(".", 1)
        settings = ", ".join(f"{type(part).__name__}(**{asdict(part)})" for part in (make() for make in self.settings))
        program = f"""if True:
            import os, pkgutil, signal
            os.chdir({os.getcwd()!r})
            os.environ["RELIGHT_SNAKEMAKE"] = "1"
            from pathlib import Path
            from relight.config import Augment, Loss, Model, Track, Train
            from relight.stages.train import main

            owner = pkgutil.resolve_name({owner!r})
            calls, function = [], owner.{name}

            def last(*arguments, **options):
                function(*arguments, **options)
                calls.append(1)
                if len(calls) == {count}:
                    os.kill(os.getpid(), signal.SIGKILL)

            owner.{name} = last
            files = {{name: Path(path) for name, path in { {n: str(p) for n, p in self.paths.items()} }.items()}}
            main({settings}, Track({self.uri!r}, "test"), **files, out=Path({str(OUT)!r}), curve=Path({str(CURVE)!r}))
        """
        process = FORKS.Process(target=exec, args=(program, {}))
        process.start()
        process.join(timeout=240)
        assert process.exitcode == -9

    def runs(self, experiment: str = "test") -> list:
        client = MlflowClient(self.uri)
        found = client.get_experiment_by_name(experiment)
        return client.search_runs([found.experiment_id], order_by=["attributes.start_time"]) if found else []

    def logged(self, run) -> list[tuple[int, float]]:
        return [(m.step, m.value) for m in MlflowClient(self.uri).get_metric_history(run.info.run_id, "loss")]


FORKS = multiprocessing.get_context("forkserver")  # to import torch and MLflow once for all that are killed
FORKS.set_forkserver_preload(["relight.learning.train", "mlflow", "mlflow.store.tracking.sqlalchemy_store"])


@pytest.fixture(scope="module")
def empty(tmp_path_factory) -> Path:
    """A database without runs: to make one takes seconds."""
    folder = tmp_path_factory.mktemp("store")
    store.create_database(f"sqlite:///{folder}/empty.db")
    return folder / "empty.db"


@pytest.fixture
def training(tmp_path, monkeypatch, empty, world, model, loss, schedule, augment) -> Training:
    monkeypatch.chdir(tmp_path)
    made = Training(world, model, loss, schedule, augment)
    shutil.copy(empty, made.database)
    return made


def curve(network: Path = OUT) -> list[tuple[int, float]]:
    with open(network.with_suffix(".csv"), newline="") as file:
        return [(int(row["step"]), float(row["loss"])) for row in csv.DictReader(file)]


def header(network: Path = OUT) -> dict:
    with safe_open(network, "np") as file:
        return json.loads(file.metadata()["relight"])


def check_run(training: Training, run, made: dict, points: list[tuple[int, float]]) -> Path:
    """Parameters, metrics, inputs and artifacts of a run are those of the training that wrote a network.

    Args:
        training: where it is.
        run: in MLflow.
        made: the header of the network.
        points: its curve.

    Returns:
        The folder of the run's artifacts.
    """
    assert run.info.status == "FINISHED" and run.data.tags["fingerprint"] == made["fingerprint"]
    settings = {part: made[part] for part in ("model", "loss", "train", "augment")}
    assert run.data.params == {key: str(value) for key, value in flat(settings).items()}
    folder = Path("mlruns") / run.info.experiment_id / run.info.run_id / "artifacts"
    assert yaml.safe_load((folder / "config.yaml").read_text()) == settings
    assert training.logged(run) == points
    drawn = [int(path.name.split("+")[2]) for path in sorted(folder.glob("images/*.png"))]
    assert sorted(drawn) == [4, 8], "a picture an epoch"
    inputs = {made.dataset.name: made.dataset.digest for made in run.inputs.dataset_inputs}
    for name, path in zip(("figures", "lights", "split"), training.paths.values(), strict=True):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        assert run.data.tags[f"data.{name}"] == digest and inputs[name] == digest[:36]
    return folder


def logged_network(run) -> bytes:
    """The file of the model that a run logged."""
    (model,) = run.outputs.model_outputs
    (kept,) = Path("mlruns").glob(f"*/models/{model.model_id}/artifacts/data/*.safetensors")
    return kept.read_bytes()


def test_other_settings_are_another_run_and_each_tells_its_own(training):
    told = []
    for lr in (2e-3, 1e-3):
        training(lr=lr)
        told.append((header(), curve()))
    for run, (made, points) in zip(training.runs(), told, strict=True):
        check_run(training, run, made, points)
        assert run.info.run_name == "one.s0"
    assert logged_network(run) == OUT.read_bytes()


def test_a_sweep_has_an_experiment_and_a_parent_of_its_own(training, monkeypatch):
    """Beside a run of the tables that has the settings of one of its trainings."""
    words = ["scale=smoke", "experiment=one", f"track.uri={training.uri}"]
    rows = {f"lr_{lr}": [f"train.lr={lr}"] for lr in (0.002, 0.001)}
    plans = [Plan({"hydra": words}), Plan({"hydra": words, "rows": rows})]
    flows = [plan.workflow() for plan in plans]
    given = [(flows[0], "one", 0.002), *((flows[1], row, float(row[3:])) for row in rows)]
    networks = {f"{row}.s0": Path("train") / f"{row}.s0.safetensors" for _, row, _ in given}
    for (flow, _, lr), network in zip(given, networks.values()):
        monkeypatch.setenv(WORKFLOW, flow.to_json())
        training(out=network, lr=lr)
    report = plans[1].write_record(".").with_name("report")
    report.mkdir()
    (report / "sweep.csv").write_text("row\n")
    own = {name: path for name, path in networks.items() if name != "one.s0"}
    finish_workflow(flows[1], own, report)
    assert not training.runs()
    for flow, names in zip(flows, (["one.s0"], list(own))):
        above, *below = training.runs(flow.track.experiment)
        assert above.info.run_name == "smoke" and "mlflow.parentRunId" not in above.data.tags
        assert above.data.params == {key: str(value) for key, value in flat(flow.settings).items()}
        assert [run.info.run_name for run in below] == names
        for run in below:
            network = networks[run.info.run_name]
            folder = check_run(training, run, header(network), curve(network))
            assert (folder / f"{network.stem}.csv").read_bytes() == network.with_suffix(".csv").read_bytes()
            assert run.data.tags["mlflow.parentRunId"] == above.info.run_id
            assert run.data.tags["sweep"] == str(flow is flows[1]).lower()
            assert logged_network(run) == network.read_bytes()
    note = above.data.tags["mlflow.note.content"]
    assert "compare-runs" in note and all(run.info.run_id in note for run in below), "the comparison of the sweep"
    kept = Path("mlruns") / above.info.experiment_id / above.info.run_id / "artifacts" / "report" / "sweep.csv"
    assert kept.exists() and flows[0].track.experiment == "smoke" and flow.track.experiment == "smoke sweeps"


@pytest.mark.parametrize("broken", ["artifacts", "database", "lock", "server"])
def test_what_fails_in_mlflow_is_a_warning(training, capsys, monkeypatch, broken):
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    if broken == "artifacts":
        Path("mlruns").write_text("in the way of the folder")
    elif broken == "database":
        training.database.write_text("no database")
    elif broken == "lock":
        Path(".mlflow.lock").mkdir()
    training(uri="http://127.0.0.1:9" if broken == "server" else training.uri)
    assert OUT.exists() and [step for step, _ in curve()] == [4, 8]
    told = [line for line in capsys.readouterr().err.splitlines() if "MLflow" in line]
    assert len(told) == 1 and "is not recorded" in told[0], told
    if broken == "artifacts":
        (run,) = training.runs()
        assert run.info.status == "FINISHED" and training.logged(run) == curve()


def test_what_a_locked_store_missed_is_there_at_the_end(training, capsys, monkeypatch):
    """Another process holds the database while the first epoch ends."""
    monkeypatch.setattr(store, "SQLITE_TIMEOUT", 0.1)
    holder, log = sqlite3.connect(training.database, isolation_level=None), TrainingRun.log
    holder.execute("BEGIN EXCLUSIVE")

    def locked_once(run, values, step):
        log(run, values, step)
        if holder.in_transaction:
            holder.rollback()

    monkeypatch.setattr(TrainingRun, "log", locked_once)
    training()
    assert "database is locked" in capsys.readouterr().err
    (run,) = training.runs()
    assert run.info.status == "FINISHED" and training.logged(run) == curve()


@pytest.mark.parametrize(
    ("function", "count", "left"),
    [
        ("mlflow.MlflowClient.log_batch", 3, 4),
        ("relight.learning.train.save_state", 2, 8),
        ("relight.learning.train.write_curve", 1, 8),
        ("mlflow.MlflowClient.set_terminated", 1, 8),
    ],
)
def test_killed_anywhere_it_goes_on_in_its_own_run(training, capsys, function, count, left):
    """Snakemake deletes what a killed job had written; the state stays, and each step is logged once."""
    training.killed(function, count)
    for path in (OUT, CURVE):
        path.unlink(missing_ok=True)
    training()
    assert f"going on from step {left}" in capsys.readouterr().err
    (run,) = training.runs()
    assert run.info.status == "FINISHED" and training.logged(run) == curve()


def test_the_same_training_again_adds_nothing(training, monkeypatch):
    training()
    before, network = training.runs(), OUT.read_bytes()
    assert not STATE.parent.parent.exists()
    monkeypatch.setenv("RELIGHT_SNAKEMAKE", str(os.getpid()))
    training()
    assert OUT.read_bytes() == network and STATE.exists(), "Snakemake has yet to record the outputs"
    assert [training.logged(run) for run in training.runs()] == [curve()]
    assert [run.info.end_time for run in training.runs()] == [run.info.end_time for run in before]


def test_scores_are_added_to_the_run_of_their_network(training):
    training()
    one = TrainingRun(Track(training.uri, "test"), OUT.stem, header()["fingerprint"], {})
    for _ in range(2):
        one.log_scores({"test/light_rmse": 0.5}, OUT, CURVE)
    one.log_scores({"test/light_rmse": 0.25}, OUT)
    (run,) = training.runs()
    history = MlflowClient(training.uri).get_metric_history(run.info.run_id, "test/light_rmse")
    assert [point.value for point in history] == [0.5, 0.25]


def test_a_network_that_a_killed_training_did_not_log_comes_with_its_scores(training):
    training()
    one = TrainingRun(Track(training.uri, "test"), "killed.s0", "9" * 64, {})
    for score in (0.5, 0.25):
        one.log_scores({"test/light_rmse": score}, OUT)
    assert not one.warnings
    assert len(MlflowClient(training.uri).get_run(one.id).outputs.model_outputs) == 1


def test_a_moved_folder_keeps_its_artifacts_with_it(training, tmp_path, monkeypatch):
    """Also one whose database was made when places were absolute."""
    training()
    moved = tmp_path.with_name(f"{tmp_path.name}_moved")
    with closing(sqlite3.connect(training.database)) as database, database:
        database.execute(f"UPDATE experiments SET artifact_location = '{tmp_path}/' || artifact_location")
        database.execute(f"UPDATE runs SET artifact_uri = '{tmp_path}/' || artifact_uri")
        database.execute(f"UPDATE logged_models SET artifact_location = '{tmp_path}/' || artifact_location")
    tmp_path.rename(moved)
    monkeypatch.chdir(moved)
    training.database = training.database.rename(f"{moved.name}.db")
    training.uri = f"sqlite:///{training.database}"
    training(lr=1e-3)
    assert not tmp_path.exists()
    client = MlflowClient(training.uri)
    for run in training.runs():
        names = {item.path for item in client.list_artifacts(run.info.run_id)}
        assert names == {"config.yaml", CURVE.name, "images"}
        assert (Path("mlruns") / run.info.experiment_id / run.info.run_id / "artifacts" / CURVE.name).exists()
        assert client.get_logged_model(run.outputs.model_outputs[0].model_id).artifact_location.startswith("mlruns/")


def test_a_command_that_fails_leaves_nothing(training, tmp_path):
    (tmp_path / "split.json").write_text('{"train": ["nobody"], "test": []}')
    for paths in ({"split": tmp_path / "split.json"}, {"packed": tmp_path / "nothing.safetensors"}):
        with pytest.raises(UserError):
            training(paths)
    assert {path.name for path in tmp_path.iterdir()} == {training.database.name, "split.json"}
