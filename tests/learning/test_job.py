"""The job that trains: no kill and no failure of MLflow loses a training, and its run in MLflow tells the truth."""

import csv
import json
import multiprocessing
import os
import shutil
import sqlite3
from dataclasses import asdict
from pathlib import Path

import pytest
from mlflow import MlflowClient
from safetensors import safe_open

from relight.core.errors import UserError
from relight.lab.tracking import store
from relight.lab.tracking.run import TrainingRun
from relight.lab.training import train
from relight.learning.train import Inputs
from relight.settings import flat

OUT, CURVE, STATE = (Path("train") / name for name in ("one.s0.safetensors", "one.s0.csv", "state/one.s0/state.pt"))

pytestmark = pytest.mark.slow


class Training:
    """The job in a folder of its own, with a database of its own, as a function of changed settings."""

    def __init__(self, world, model, loss, schedule, augment):
        self.settings = model, loss, schedule, augment
        self.paths = {name: world[name] for name in ("packed", "lights", "split")}
        self.database = Path(f"{Path.cwd().name}.db")  # MLflow keeps the connection to a name
        self.uri = f"sqlite:///{self.database}"

    def given(self, paths: dict | None = None, **changes) -> tuple:
        model, loss, schedule, augment = self.settings
        tracking = {"track": {"uri": changes.pop("uri", self.uri), "experiment": "test"}, "tags": {}, "rows": {}}
        groups = {"model": model(), "loss": loss(), "train": schedule(**changes), "augment": augment()}
        settings = {name: asdict(group) for name, group in groups.items()}
        return settings, Inputs(**{**self.paths, **(paths or {})}), OUT, CURVE, tracking

    def __call__(self, *paths: dict, **changes) -> None:
        train(*self.given(*paths, **changes))

    def killed(self, function: str, count: int) -> None:
        """The job, in a process that ends by SIGKILL when `function` was called so often."""
        owner, name = function.rsplit(".", 1)
        program = f"""if True:
            import os, pkgutil, signal
            os.chdir({os.getcwd()!r})
            os.environ["MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL"] = "600"  # whose thread would be counted, too
            from relight.lab.tracking import run
            from relight.lab.training import train
            run.log_network = lambda *_: None
            owner = pkgutil.resolve_name({owner!r})
            calls, function = [], owner.{name}
            def last(*arguments, **options):
                function(*arguments, **options)
                calls.append(1)
                if len(calls) == {count}:
                    os.kill(os.getpid(), signal.SIGKILL)
            owner.{name} = last
            train(*given)
        """
        process = FORKS.Process(target=exec, args=(program, {"given": self.given()}))
        process.start()
        process.join(timeout=240)
        assert process.exitcode == -9

    def runs(self, experiment: str = "test") -> list:
        client = MlflowClient(self.uri)
        found = client.get_experiment_by_name(experiment)
        return client.search_runs([found.experiment_id], order_by=["attributes.start_time"]) if found else []

    def logged(self, run) -> list[tuple[int, float]]:
        return [(m.step, m.value) for m in MlflowClient(self.uri).get_metric_history(run.info.run_id, "loss/train")]


FORKS = multiprocessing.get_context("forkserver")  # to import torch and MLflow once for all that are killed
FORKS.set_forkserver_preload(["relight.learning.train", "mlflow", "mlflow.store.tracking.sqlalchemy_store"])


@pytest.fixture
def training(tmp_path, monkeypatch, empty_store, world, model, loss, schedule, augment) -> Training:
    """Networks are files of their runs, not models, each of which takes a quarter of a minute."""
    monkeypatch.chdir(tmp_path)
    of_run = "relight.lab.tracking.run.log_network"
    monkeypatch.setattr(of_run, lambda run, network: MlflowClient().log_artifact(run, network, "network"))
    made = Training(world, model, loss, schedule, augment)
    shutil.copy(empty_store, made.database)
    return made


def curve() -> list[tuple[int, float]]:
    with open(CURVE, newline="") as file:
        return [(int(row["step"]), float(row["loss"])) for row in csv.DictReader(file)]


def test_other_settings_are_another_run_and_each_tells_its_own(training):
    told = []
    for lr in (2e-3, 1e-3):
        training(lr=lr)
        with safe_open(OUT, "np") as file:
            told.append((json.loads(file.metadata()["relight"]), curve()))
    for run, (made, points) in zip(training.runs(), told, strict=True):
        assert run.info.status == "FINISHED" and run.data.tags["fingerprint"] == made["fingerprint"]
        settings = {part: made[part] for part in ("model", "loss", "train", "augment")}
        assert run.data.params == {key: str(value) for key, value in flat(settings).items()}
        assert training.logged(run) == points
        folder = Path("mlruns") / run.info.run_id / "artifacts"
        drawn = [int(path.name.split("+")[2]) for path in sorted(folder.glob("images/*.png"))]
        assert sorted(drawn) == [4, 8], "a picture an epoch"
        assert (folder / "curve" / CURVE.name).exists()
    assert [run.info.run_name for run in training.runs()] == ["one.s0 (earlier)", "one.s0"]
    networks = [path.read_bytes() for path in Path("mlruns").glob(f"*/artifacts/network/{OUT.name}")]
    assert len(networks) == 2 and OUT.read_bytes() in networks


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

    def locked_once(run, values, step, picture):
        log(run, values, step, picture)
        if holder.in_transaction:
            holder.rollback()

    monkeypatch.setattr(TrainingRun, "log", locked_once)
    training()
    assert "database is locked" in capsys.readouterr().err
    (run,) = training.runs()
    assert run.info.status == "FINISHED" and training.logged(run) == curve()


@pytest.mark.parametrize(("function", "count", "left"), [
    ("mlflow.MlflowClient.log_batch", 3, 4),
    ("mlflow.MlflowClient.set_terminated", 1, 8),
])  # fmt: skip
def test_killed_anywhere_it_goes_on_in_its_own_run(training, capsys, function, count, left):
    """Snakemake deletes what a killed job had written; the state stays, and each step is logged once."""
    training.killed(function, count)
    OUT.unlink(missing_ok=True), CURVE.unlink(missing_ok=True)
    training()
    assert f"going on from step {left}" in capsys.readouterr().err
    (run,) = training.runs()
    assert run.info.status == "FINISHED" and training.logged(run) == curve()


def test_the_same_training_again_adds_nothing(training):
    training()
    before, network = training.runs(), OUT.read_bytes()
    training()
    assert OUT.read_bytes() == network and STATE.exists(), "Snakemake has yet to record the outputs"
    ends = [(run.info.end_time, training.logged(run)) for run in training.runs()]
    assert ends == [(run.info.end_time, curve()) for run in before] and len(ends) == 1


def test_a_command_that_fails_leaves_a_failed_run_at_most(training, tmp_path):
    (tmp_path / "split.json").write_text('{"train": ["nobody"], "test": []}')
    for paths in ({"split": tmp_path / "split.json"}, {"packed": tmp_path / "nothing.safetensors"}):
        with pytest.raises(UserError):
            training(paths)
    assert {path.name for path in tmp_path.iterdir()} == {training.database.name, ".mlflow.lock", "split.json"}
    assert [run.info.status for run in training.runs()] == ["FAILED"]
