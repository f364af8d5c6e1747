"""MLflow: the store is made once under contention, and a killed job finds its run again."""

import subprocess
import sys
from pathlib import Path

import pytest

from relight.config import Track

CODE = """
import sys
from pathlib import Path
from relight.config import Track
from relight.track import tracked
name = sys.argv[1]
with tracked(Track("sqlite:///mlflow.db", "test"), name, Path(name) / "mlflow.txt", {"lr": 1}) as mlflow:
    mlflow.log_metrics({"loss": 0.5}, step=int(sys.argv[2]))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder in which three processes started runs at once, with no store there."""
    folder = tmp_path_factory.mktemp("track")
    jobs = [subprocess.Popen([sys.executable, "-c", CODE, f"run{i}", "0"], cwd=folder) for i in range(3)]
    assert [job.wait(timeout=120) for job in jobs] == [0, 0, 0]
    return folder


def test_processes_share_a_new_store(folder, monkeypatch):
    import mlflow

    monkeypatch.chdir(folder)
    mlflow.set_tracking_uri("sqlite:///mlflow.db")
    runs = mlflow.search_runs(experiment_names=["test"], output_format="list")
    assert sorted(run.info.run_name for run in runs) == ["run0", "run1", "run2"]
    assert {run.data.params["lr"] for run in runs} == {"1"}


def test_a_run_is_found_again(folder, monkeypatch):
    from relight.track import tracked

    monkeypatch.chdir(folder)
    record = Path("run1/mlflow.txt")
    before = record.read_text()
    with tracked(Track("sqlite:///mlflow.db", "test"), "run1", record, {"lr": 1}) as mlflow:
        run_id = mlflow.active_run().info.run_id
        mlflow.log_metrics({"loss": 0.25}, step=1)
    assert run_id == before
    history = mlflow.MlflowClient().get_metric_history(run_id, "loss")
    assert [(point.step, point.value) for point in history] == [(0, 0.5), (1, 0.25)]


def test_a_forgotten_run_is_made_anew(folder, monkeypatch):
    from relight.track import tracked

    monkeypatch.chdir(folder)
    record = folder / "gone.txt"
    record.write_text("0" * 32)
    with tracked(Track("sqlite:///mlflow.db", "test"), "gone", record) as mlflow:
        run_id = mlflow.active_run().info.run_id
        assert run_id != "0" * 32 and record.read_text() == run_id
