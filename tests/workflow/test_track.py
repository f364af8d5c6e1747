"""MLflow: the store is made once under contention, whole or not at all, and a killed job finds its run again."""

import subprocess
import sys
from pathlib import Path

import pytest
from mlflow import MlflowClient

from relight.config import ROOT, Track
from relight.track import Run

URI = "sqlite:///mlflow.db"

pytestmark = pytest.mark.slow
CODE = """
import sys
from relight.config import Track
from relight.track import Run
Run(Track("sqlite:///mlflow.db", "test"), sys.argv[1], "1" * 64, {"lr": 1}).log({"loss": 0.5}, 0)
"""
KILLED = """
import os, signal
from mlflow.store.tracking import sqlalchemy_store
from relight.track import create

class Store:
    def __init__(self, uri, *_):
        path = uri.removeprefix("sqlite:///")
        for name in (path, path + "-journal"):
            open(name, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)

sqlalchemy_store.SqlAlchemyStore = Store
create("sqlite:///mlflow.db")
"""


def python(code: str, *words: str, folder: Path) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-c", code, *words], cwd=folder, env={"PYTHONPATH": str(ROOT)})


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder in which a process was killed while it made the store, and then three started runs at once."""
    folder = tmp_path_factory.mktemp("track")
    assert python(KILLED, folder=folder).wait(timeout=120) == -9
    assert not list(folder.glob("*-journal")) and not list(folder.glob(".*-journal"))
    jobs = [python(CODE, f"run{i}", folder=folder) for i in range(3)]
    assert [job.wait(timeout=300) for job in jobs] == [0, 0, 0]
    return folder


@pytest.fixture
def client(folder, monkeypatch) -> MlflowClient:
    monkeypatch.chdir(folder)
    return MlflowClient(URI)


def runs(client) -> list:
    return client.search_runs([client.get_experiment_by_name("test").experiment_id], order_by=["attributes.run_name"])


def test_processes_share_a_new_store(client, folder):
    assert {path.name for path in folder.iterdir()} == {"mlflow.db", ".mlflow.lock"}
    assert [run.info.run_name for run in runs(client)] == ["run0", "run1", "run2"]
    assert {run.data.params["lr"] for run in runs(client)} == {"1"}
    assert {run.info.artifact_uri.split("/")[0] for run in runs(client)} == {"mlruns"}


def test_a_run_is_found_again_by_name_and_fingerprint(client):
    before = {run.info.run_id for run in runs(client)}
    again = Run(Track(URI, "test"), "run1", "1" * 64, {"lr": 1})
    again.log({"loss": 0.5}, 0)
    again.log({"loss": 0.25}, 1)
    assert {run.info.run_id for run in runs(client)} == before
    assert [(point.step, point.value) for point in client.get_metric_history(again.id, "loss")] == [(0, 0.5), (1, 0.25)]
    other = Run(Track(URI, "test"), "run1", "2" * 64, {"lr": 2})
    other.log({"loss": 0.5}, 0)
    assert other.id not in before and client.get_run(other.id).data.params["lr"] == "2"
    client.delete_run(other.id)


def test_a_deleted_run_is_made_anew(client):
    runs_of_one = [Run(Track(URI, "test"), "gone", "3" * 64, {}) for _ in range(2)]
    runs_of_one[0].log({"loss": 0.5}, 0)
    client.delete_run(runs_of_one[0].id)
    runs_of_one[1].log({"loss": 0.5}, 0)
    assert runs_of_one[1].id not in (None, runs_of_one[0].id)
    client.delete_run(runs_of_one[1].id)
