"""MLflow: the store is made once under contention, whole or not at all; workflows have runs above their trainings; a
server, and nothing at all, do as well."""

import multiprocessing
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import psutil
import pytest
from mlflow import MlflowClient

from relight.config import ROOT, Model, Track
from relight.files import UserError, file_hash
from relight.learning.checkpoint import save_network
from relight.learning.networks import build
from relight.tracking import store
from relight.tracking.run import TrainingRun
from relight.tracking.server import download_network
from relight.tracking.workflow import WORKFLOW, Workflow, finish_workflow
from relight.workflow import Plan

URI = "sqlite:///mlflow.db"
NETWORK = Model(
    name="ours", width=0.125, norm="batch", dropout=0.5, order=2, albedo="clip", light_head="strided", refine=False,
    sees="image",
)  # fmt: skip
WRITERS = 8
FLOW = Workflow(Track(URI, "test"), "demo", "9" * 64, {"a": {"b": 1}}, {"ours": ["table1", "table2"]}, {"sweep": "no"})
FORKS = multiprocessing.get_context("forkserver")  # to import MLflow once for all writers
FORKS.set_forkserver_preload(["mlflow", "mlflow.store.tracking.sqlalchemy_store", "relight.tracking.run"])

pytestmark = pytest.mark.slow
KILLED = """
import os, signal
from mlflow.store.tracking import sqlalchemy_store
from relight.tracking.store import create_database

class Store:
    def __init__(self, uri, *_):
        path = uri.removeprefix("sqlite:///")
        for name in (path, path + "-journal"):
            open(name, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)

sqlalchemy_store.SqlAlchemyStore = Store
create_database("sqlite:///mlflow.db")
"""
WRITER = """
import os, sys
os.chdir({folder!r})
os.environ["RELIGHT_WORKFLOW"] = {flow!r}
from relight.config import Track
from relight.tracking import store
from relight.tracking.run import TrainingRun
run = TrainingRun(Track(), "ours.s{seed}", str({seed}) * 64, {{"lr": {seed}}})
for step in range(3):
    run.log({{"loss": {seed} + step / 4}}, step)
"""


def write_at_once(folder: Path, flow: Workflow) -> None:
    """Trainings of a workflow, all at the same time, in a folder."""
    programs = [WRITER.format(folder=str(folder), flow=flow.to_json(), seed=seed) for seed in range(WRITERS)]
    jobs = [FORKS.Process(target=exec, args=(program, {})) for program in programs]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join(timeout=300)
    assert [job.exitcode for job in jobs] == WRITERS * [0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder in which a process was killed while it made the store, and then eight trainings started at once."""
    folder = tmp_path_factory.mktemp("track")
    killed = subprocess.run([sys.executable, "-c", KILLED], cwd=folder, env={"PYTHONPATH": str(ROOT)}, timeout=120)
    assert killed.returncode == -9
    assert not list(folder.glob("*-journal")) and not list(folder.glob(".*-journal"))
    write_at_once(folder, FLOW)
    return folder


@pytest.fixture
def postgres() -> Iterator[str]:
    """The address of an empty database of a PostgreSQL server that listens on this machine only."""
    options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.STDOUT}
    if os.getuid() == 0:  # whom the server refuses
        options |= {"user": "nobody", "group": "nogroup", "extra_groups": []}
    with tempfile.TemporaryDirectory() as folder, socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        if "user" in options:
            shutil.chown(folder, options["user"])
        data = f"{folder}/data"
        subprocess.run(["initdb", "--username=relight", "--auth=trust", "--no-sync", "-D", data], check=True, **options)
        free.close()
        words = f"-h 127.0.0.1 -p {port} -k {folder} -F"
        subprocess.run(["pg_ctl", "start", "-w", "-D", data, "-o", words], cwd=folder, check=True, **options)
        try:
            yield f"postgresql://relight@127.0.0.1:{port}/postgres"
        finally:
            subprocess.run(["pg_ctl", "stop", "-w", "-m", "immediate", "-D", data], check=True, **options)


@pytest.fixture
def client(folder, monkeypatch) -> MlflowClient:
    monkeypatch.chdir(folder)
    return MlflowClient(URI)


def runs(client) -> list:
    return client.search_runs([client.get_experiment_by_name("test").experiment_id], order_by=["attributes.run_name"])


def check_writers(client) -> None:
    """Each of the trainings has its own parameters and metrics, below the run of the workflow."""
    above, *trainings = runs(client)
    assert [run.info.run_name for run in trainings] == [f"ours.s{seed}" for seed in range(WRITERS)]
    for seed, run in enumerate(trainings):
        assert run.data.params == {"lr": str(seed)}
        points = client.get_metric_history(run.info.run_id, "loss")
        assert [(point.step, point.value) for point in points] == [(step, seed + step / 4) for step in range(3)]
        assert "system/cpu_utilization_percentage" in run.data.metrics
        tags = {
            "mlflow.parentRunId": above.info.run_id,
            "experiment": "table1, table2",
            "seed": str(seed),
            "sweep": "no",
        }
        assert run.data.tags.items() >= tags.items()
    assert above.info.run_name == "demo" and above.data.params == {"a.b": "1"}
    assert above.data.tags["mlflow.source.name"] == "Snakefile"


def test_processes_share_a_new_store(client, folder):
    assert {path.name for path in folder.iterdir()} == {"mlflow.db", ".mlflow.lock"}
    check_writers(client)
    assert {run.info.artifact_uri.split("/")[0] for run in runs(client)} == {"mlruns"}


@pytest.mark.skipif(not shutil.which("initdb"), reason="there is no PostgreSQL")
@pytest.mark.skipif(not find_spec("psycopg2"), reason="there is no psycopg2, the extra `postgres`")
def test_processes_share_a_database_server(postgres, tmp_path):
    write_at_once(tmp_path, replace(FLOW, track=Track(postgres, "test")))
    assert {path.name for path in tmp_path.iterdir()} == {".mlflow.lock"}
    check_writers(MlflowClient(postgres))


def test_a_run_is_found_again_by_name_and_fingerprint(client):
    before = {run.info.run_id for run in runs(client)}
    again = TrainingRun(Track(URI, "test"), "ours.s1", "1" * 64, {"lr": 1})
    again.log({"loss": 9.0}, 2)
    again.log({"loss": 0.25}, 3)
    assert {run.info.run_id for run in runs(client)} == before
    points = [(point.step, point.value) for point in client.get_metric_history(again.id, "loss")]
    assert points == [(0, 1), (1, 1.25), (2, 1.5), (3, 0.25)]
    other = TrainingRun(Track(URI, "test"), "ours.s1", "2" * 64, {"lr": 2})
    other.log({"loss": 0.5}, 0)
    assert other.id not in before and client.get_run(other.id).data.params["lr"] == "2"
    client.delete_run(other.id)


def test_a_deleted_run_is_made_anew(client):
    runs_of_one = [TrainingRun(Track(URI, "test"), "gone", "3" * 64, {}) for _ in range(2)]
    runs_of_one[0].log({"loss": 0.5}, 0)
    client.delete_run(runs_of_one[0].id)
    runs_of_one[1].log({"loss": 0.5}, 0)
    assert runs_of_one[1].id not in (None, runs_of_one[0].id)
    client.delete_run(runs_of_one[1].id)


def trained(name: str, mark: str, curve: Path, score: float, complete: bool = True, part: str = "train") -> Path:
    """A finished training with a network of its own, scored; if not complete, it has no light."""
    network = curve.parent / f"{name}.safetensors"
    save_network(network, build(NETWORK, 64), NETWORK, fingerprint=mark, train={"color": "photo"})
    run = TrainingRun(Track(), name, mark, {"train": {"color": "photo", "part": part, "lights": [part]}})
    run.finish(curve, network)
    maps = ("shading", "albedo", "light") if complete else ("shading", "albedo")
    run.log_scores({f"test/{name}_rmse": score for name in maps}, network)
    assert not run.warnings
    return network


def test_the_end_of_a_workflow(tmp_path, folder, client, monkeypatch):
    """Its report among its artifacts, its trainings in its description, and its best network loads in both ways."""
    import mlflow

    from relight.learning.checkpoint import load_network
    from relight.learning.predict import predict
    from relight.photos.api import load

    flow = replace(FLOW, name="ended", fingerprint="8" * 64)
    monkeypatch.setenv(WORKFLOW, flow.to_json())
    (folder / "report").mkdir()
    for name in ("report/report.html", "report/table1.csv", "report/notes.bin", "run.yaml"):
        (folder / name).write_text("x")
    curve = tmp_path / "curve.csv"
    curve.write_text("step,loss,validation/loss\n4,0.5,0.75\n")
    scores: dict[str, tuple] = {"ours.s0": (0.3,), "ours.s1": (0.2,)}
    scores |= {"silhouette.s0": (0.1, False), "self_all.s0": (0.1, True, "test")}  # neither can be the best
    networks = {name: trained(name, name, curve, *how) for name, how in scores.items()}
    finish_workflow(flow, networks, folder / "report")
    run = next(run for run in runs(client) if run.info.run_name == "ended")
    assert run.info.status == "FINISHED" and run.data.tags["best"] == "ours.s1"
    assert {item.path for item in client.list_artifacts(run.info.run_id)} == {"config.yaml", "report", "run.yaml"}
    kept = {item.path for item in client.list_artifacts(run.info.run_id, "report")}
    assert kept == {"report/report.html", "report/table1.csv"}
    note = run.data.tags["mlflow.note.content"]
    assert "### table2" in note and "| 0.2000 |" in note and "compare-runs" in note

    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{folder}/mlflow.db")
    monkeypatch.setattr("relight.tracking.server.ROOT", folder)
    assert load("models:/relight@photo").network.digest == file_hash(networks["ours.s1"])
    assert download_network("models:/relight@photo").read_bytes() == networks["ours.s1"].read_bytes()
    with pytest.raises(UserError, match=r"models:/relight@nothing is not in MLflow"):
        load("models:/relight@nothing")
    mlflow.set_tracking_uri(URI)
    served = mlflow.pyfunc.load_model("models:/relight@photo")
    example = served.input_example
    network, _ = load_network(networks["ours.s1"])
    found, wanted = served.predict(example), predict(network, example["image"], example["mask"])
    assert served.metadata.signature.outputs.input_names() == list(found)
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[name], values)
    assert not [path for path in folder.rglob("*") if path.suffix in (".pkl", ".pickle", ".pth")], "no pickle"


def test_a_failure_is_recorded_even_after_a_success(tmp_path, folder, client, monkeypatch):
    """A training or workflow that is made again and fails did not finish; one that has no run gets none."""
    first = TrainingRun(Track(URI, "test"), "again", "4" * 64, {})
    first.log({"loss": 0.5}, 0)
    first.attempt(first.end)
    TrainingRun(Track(URI, "test"), "again", "4" * 64, {}).fail()
    assert client.get_run(first.id).info.status == "FAILED"
    count = len(runs(client))
    TrainingRun(Track(URI, "test"), "never", "5" * 64, {}).fail()
    assert len(runs(client)) == count
    client.delete_run(first.id)

    flow = replace(FLOW, name="twice", fingerprint="6" * 64)
    (folder / "train").mkdir(exist_ok=True)
    finish_workflow(flow, {}, folder / "report", failed=True)
    assert "twice" not in {run.info.run_name for run in runs(client)}
    finish_workflow(flow, {}, folder / "report")
    finish_workflow(flow, {}, folder / "report", failed=True)
    (run,) = (run for run in runs(client) if run.info.run_name == "twice")
    assert run.info.status == "FAILED"
    client.delete_run(run.info.run_id)


def test_without_an_address_nothing_is_tracked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run = TrainingRun(Track(), "ours.s0", "1" * 64, {"lr": 1})
    run.log({"loss": 0.5}, 0)
    run.log_scores({"test": 1.0}, tmp_path / "ours.safetensors")
    finish_workflow(replace(FLOW, track=Track()), {}, tmp_path)
    assert not list(tmp_path.iterdir()) and capsys.readouterr() == ("", "")


def test_mlflow_is_silenced_before_anything_imports_it(monkeypatch):
    """Its monitors of the machine come first; and it would tell its makers that it is used."""
    for variable in store.DEFAULTS:
        monkeypatch.delenv(variable, raising=False)
    TrainingRun(Track(URI, "test"), "ours.s0", "1" * 64, {"lr": 1})
    assert store.DEFAULTS.items() <= os.environ.items() and store.DEFAULTS["DO_NOT_TRACK"] == "true"


def test_a_workflow_tells_what_was_asked_for(monkeypatch):
    plan = Plan({"hydra": "scale=smoke experiment=[table1,table2] track.experiment=own"})
    flow = plan.workflow()
    monkeypatch.setenv(WORKFLOW, flow.to_json())
    assert Workflow.from_environment() == flow and flow.track == Track("sqlite:///mlflow.db", "own")
    assert flow.rows["ours_full"] == ["table1", "table2"] and flow.tags["sweep"] == "false"
    assert flow.settings["train"]["steps"] == 24 and "track" not in flow.settings
    others = ("scale=smoke", "scale=smoke train.lr=0.5", "scale=smoke track=none")
    marks = [Plan({"hydra": words}).workflow().fingerprint for words in others]
    assert marks[0] == marks[2] != marks[1]
    swept = Plan({"hydra": "scale=smoke", "rows": {"lr_1": ["train.lr=1"]}}).workflow()
    assert (
        swept.track.experiment == "smoke sweeps" and swept.tags["sweep"] == "true" and swept.rows == {"lr_1": ["sweep"]}
    )


def test_runs_on_a_server_and_the_server_of_relight_ui(tmp_path):
    """`relight ui` takes overrides, says where the runs are, and is one server that ends with it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["ui", f"track.uri=sqlite:///{tmp_path}/a.db", "track.experiment=mine", "--port", str(port)]
    server = subprocess.Popen(
        [sys.executable, "-m", "relight.cli", *words],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        line = server.stdout.readline()
        address = f"http://127.0.0.1:{port}"
        assert line.startswith(f"MLflow: {address}/#/experiments/1/runs")
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            try:
                urllib.request.urlopen(f"{address}/health").read()
                break
            except OSError:
                time.sleep(0.2)
        run = TrainingRun(Track(address, "mine"), "ours.s0", "1" * 64, {str(i): i for i in range(150)})
        run.add_image(np.zeros((8, 8, 3), np.uint8), 4)
        run.log({"loss": 0.5}, 4)
        assert not run.warnings
        found = MlflowClient(address).get_run(run.id)
        assert found.info.experiment_id == "1" and found.data.metrics["loss"] == 0.5 and len(found.data.params) == 150
        assert MlflowClient(address).list_artifacts(run.id, "images")
        family = [server.pid, *(child.pid for child in psutil.Process(server.pid).children(recursive=True))]
        assert len(family) <= 4, "one person looks"
    finally:
        server.send_signal(signal.SIGTERM)
        server.wait(timeout=60)
    left = psutil.wait_procs([psutil.Process(pid) for pid in family if psutil.pid_exists(pid)], timeout=30)[1]
    assert not left
