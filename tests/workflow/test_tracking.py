"""MLflow: the store is made once under contention, whole or not at all; trainings are recorded in every
kind of store; nothing at all does as well."""

import multiprocessing
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import chdir
from pathlib import Path

import mlflow
import psutil
import pytest
from mlflow import MlflowClient

from relight.core.errors import UserError
from relight.lab.tracking import run as tracking_run
from relight.lab.tracking import store
from relight.lab.tracking.run import TrainingRun, log_report, log_scores, training_run
from relight.learning.checkpoint import save_network
from relight.learning.networks import build
from relight.learning.training_name import COLORS
from relight.settings import Model, Track

URI = "sqlite:///mlflow.db"
NETWORK = Model(
    name="ours", width=0.125, norm="batch", dropout=0.5, order=2, albedo="clip", light_head="strided", refine=False,
    sees="image",
)  # fmt: skip
WRITERS = 4
SCORES, TAGS = Path("scores.csv"), {"workflow": "demo", "experiment": "table1, table2"}
FORKS = multiprocessing.get_context("forkserver")  # to import MLflow once for all writers
FORKS.set_forkserver_preload(["mlflow", "mlflow.store.tracking.sqlalchemy_store", "relight.lab.tracking.run"])

pytestmark = pytest.mark.slow


def tracking(uri: str | None, **rows: list[str]) -> dict:
    """What a workflow gives its jobs for MLflow."""
    return {"track": {"uri": uri, "experiment": "test"}, "tags": TAGS, "rows": rows}


def in_folder(folder: Path, action, *arguments, ends: int = 0) -> None:
    """Calls a function in a process of its own, whose working folder is `folder`, and which ends with a code."""
    job = FORKS.Process(target=chdir_and_call, args=(folder, action, *arguments))
    job.start()
    job.join(timeout=300)
    assert job.exitcode == ends


def chdir_and_call(folder: Path, action, *arguments) -> None:
    with chdir(folder):
        action(*arguments)


def write(uri: str, seed: int) -> None:
    """A training of three epochs that does not end."""
    with training_run(tracking(uri, ours=["loss=min"]), f"ours.s{seed}", str(seed) * 64, {"lr": seed}) as run:
        for step in range(3):
            run.log({"loss": seed + step / 4, "validation/loss": seed}, step)
    os._exit(0)  # as if it were killed


def make_database_and_be_killed() -> None:
    """Stops between the file and its tables."""
    store.select_store(URI)

    def killed(source, target):
        Path(target).write_bytes(Path(source).read_bytes()[:100])
        os.kill(os.getpid(), signal.SIGKILL)

    store.shutil.copyfile = killed
    store.create_database(URI)


def runs(client) -> list:
    return client.search_runs([client.get_experiment_by_name("test").experiment_id], order_by=["attributes.run_name"])


def test_connect_processes_share_a_new_store(tmp_path):
    """Where a process was killed while it made the store, and then several trainings started at once."""
    in_folder(tmp_path, make_database_and_be_killed, ends=-9)
    jobs = [FORKS.Process(target=chdir_and_call, args=(tmp_path, write, URI, seed)) for seed in range(WRITERS)]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join(timeout=300)
    assert [job.exitcode for job in jobs] == WRITERS * [0]
    assert {path.name for path in tmp_path.iterdir()} == {"mlflow.db", ".mlflow.lock"}
    client = MlflowClient(f"sqlite:///{tmp_path}/mlflow.db")
    trainings = runs(client)
    assert [run.info.run_name for run in trainings] == [f"ours.s{seed}" for seed in range(WRITERS)]
    for seed, run in enumerate(trainings):
        assert run.data.params == {"loss": "min", "lr": str(seed)}
        points = client.get_metric_history(run.info.run_id, "loss/train")
        assert [(point.step, point.value) for point in points] == [(step, seed + step / 4) for step in range(3)]
        assert run.data.metrics["loss/validation"] == seed
        tags = {**TAGS, "row": "ours", "seed": str(seed), "mlflow.runColor": COLORS[0]}
        assert run.data.tags.items() >= tags.items()


def write_scores(shading: float) -> None:
    """Scores of two pairs, whose mean is `shading`; a score that a pair lacks has no mean."""
    rows = f"0,{shading - 0.25},,0.75\n1,{shading + 0.25},0.5,0.75\n"
    SCORES.write_text(f"figure,shading_rmse,light_rmse,shading_ssim\n{rows}")


def record(uri: str, losses: dict[str, float]) -> None:
    """Records a workflow whose trainings have finished and are scored, given their validation losses.

    Networks are no models, each of which takes a quarter of a minute.
    """
    tracking_run.log_network = lambda run, network: mlflow.log_artifact(str(network), "network")
    for name, loss in losses.items():
        network, settings = Path(f"{name}.safetensors"), {"train": {"color": "paper"}}
        save_network(network, build(NETWORK, 64), NETWORK, fingerprint=name.encode().hex(), **settings)
        curve = Path(f"{name}.csv")
        curve.write_text(f"step,loss,validation/loss\n4,0.5,{loss + 1}\n8,0.25,{loss}\n")
        with training_run(tracking(uri), name, name.encode().hex(), settings) as training:
            training.log({"loss": 0.5, "validation/loss": loss + 1}, 4)
            training.finish(network, curve)
            assert not training._warnings
        for condition in ("test", "sitting-test"):
            for shading in (0.6, 0.5 - loss, 0.5 - loss):  # is scored again by better code, and again after a kill
                write_scores(shading)
                log_scores(tracking(uri), network, condition, SCORES)
    Path("run.yaml").write_text("track: {uri: 'postgresql://me:secret@host/runs'}\n")
    TrainingRun(tracking(uri), "left.s0", "1" * 64, {}).open()
    mlflow.end_run("RUNNING")  # as a kill leaves it
    for _ in range(2):
        log_report(tracking(uri), [Path(f"{name}.safetensors") for name in losses], [curve], Path("run.yaml"))


def check_record(address: str) -> None:
    """The runs of `record` ended, are complete, and are children of the one of their report."""
    store.select_store(address)
    client, names = MlflowClient(), ["report of demo", "left.s0"]
    report, left, *trainings = sorted(runs(client), key=lambda run: [run.info.run_name != name for name in names])
    assert left.info.status == "KILLED" and "mlflow.parentRunId" not in left.data.tags
    assert report.info.status == "FINISHED" and report.data.metrics == report.data.params == {}
    assert [item.path for item in client.list_artifacts(report.info.run_id)] == ["run.yaml", "sfsnet.s0.csv"]
    text = mlflow.artifacts.load_text(f"runs:/{report.info.run_id}/run.yaml")
    assert text == "track: {uri: 'postgresql://me@host/runs'}\n"
    for run in trainings:
        assert run.data.tags["mlflow.parentRunId"] == report.info.run_id
        assert run.info.status == "FINISHED" and run.data.params == {"train.color": "paper"}
        assert {name for name in run.data.metrics if name.startswith("test")} == {"test_shading_rmse"}
        assert run.data.metrics["test_shading_rmse"] == pytest.approx(0.5 - LOSSES[run.info.run_name])
        assert len(client.get_metric_history(run.info.run_id, "test_shading_rmse")) == 2
        points = client.get_metric_history(run.info.run_id, "loss/train")
        assert [(point.step, point.value) for point in points] == [(4, 0.5), (8, 0.25)]
        folders = {f"scores/{name}" for name in ("test", "sitting-test")}
        assert {item.path for item in client.list_artifacts(run.info.run_id, "scores")} == folders
        name = f"{run.info.run_name}.safetensors"
        assert [item.path for item in client.list_artifacts(run.info.run_id, "network")] == [f"network/{name}"]


LOSSES = {"ours_full.s0": 0.3, "sfsnet.s0": 0.1}


def test_training_run_is_recorded_in_another_folders_sqlite_whatever_its_name(tmp_path):
    folder, other = (tmp_path / "a b'ü 50%20#1 {x}" / name for name in ("clone", "other"))
    folder.mkdir(parents=True)
    other.mkdir()
    in_folder(folder, record, f"sqlite:///{other}/o.db", LOSSES)
    made = {path.name for path in folder.iterdir() if path.suffix not in (".csv", ".safetensors", ".yaml")}
    assert made == {".mlflow.lock", "mlruns"}
    assert {path.name for path in folder.parent.iterdir()} == {"clone", "other"}
    check_record(f"sqlite:///{other}/o.db")
    for network in LOSSES:
        (kept,) = folder.glob(f"mlruns/*/artifacts/network/{network}.safetensors")
        assert kept.read_bytes() == (folder / f"{network}.safetensors").read_bytes()


def finish_what_cannot_be_exported() -> None:
    sys.stderr = open("told.txt", "w", buffering=1)
    network, path = build(NETWORK, 64), Path("ours.s0.safetensors")
    save_network(path, network, NETWORK, fingerprint="1" * 64)
    infer = network.infer
    network.infer = lambda seen, mask: infer(seen[: len(seen)], mask)
    tracking_run.load_network = lambda path: (network, {})
    with training_run(tracking(URI), "ours.s0", "1" * 64, {"lr": 1}) as run:
        run.finish(path)
    write_scores(0.5)
    log_scores(tracking(URI), path, "test", SCORES)


def test_a_network_that_torch_cannot_export_is_said_once(empty_store, tmp_path):
    """With its file; its run ends, and has its scores."""
    shutil.copy(empty_store, tmp_path / "mlflow.db")
    in_folder(tmp_path, finish_what_cannot_be_exported)
    (line,) = [line for line in (tmp_path / "told.txt").read_text().splitlines() if "MLflow" in line]
    assert line.startswith("MLflow has no model of ours.s0, whose network is ours.s0.safetensors: this network cannot")
    (run,) = runs(MlflowClient(f"sqlite:///{tmp_path}/mlflow.db"))
    assert run.info.status == "FINISHED" and run.data.metrics["test_shading_rmse"] == 0.5


def test_a_run_of_the_environment_is_left_alone(empty_store, tmp_path, monkeypatch):
    """`mlflow run` and Databricks set MLFLOW_RUN_ID for the programs that they start."""
    shutil.copy(empty_store, tmp_path / "mlflow.db")
    client = MlflowClient(f"sqlite:///{tmp_path}/mlflow.db")
    in_folder(tmp_path, train_again, "there", 1)
    (foreign,) = runs(client)
    in_folder(tmp_path, train_inside, foreign.info.run_id)
    found = {run.info.run_id: run.data.params["lr"] for run in runs(client)}
    assert found.pop(foreign.info.run_id) == "1" and [*found.values()] == ["2"]
    assert client.get_metric_history(*found, "loss/train")


def train_inside(run: str) -> None:
    os.environ |= {"MLFLOW_RUN_ID": run, "MLFLOW_ACTIVE_MODEL_ID": "m-1"}
    train_again("here", 2)


def train_again(clone: str, rate: int) -> None:
    given = tracking(URI)
    given["tags"] = {**TAGS, "clone": clone}
    with training_run(given, "ours.s0", str(rate) * 64, {"lr": rate}) as run:
        run.log({"loss": 1.0}, 4)
    os._exit(0)  # as if it were killed


def test_a_training_that_is_made_again_renames_and_ends_the_earlier_one(empty_store, tmp_path):
    shutil.copy(empty_store, tmp_path / "mlflow.db")
    for clone, rate in (("here", 1), ("there", 2), ("here", 3), ("here", 3)):
        in_folder(tmp_path, train_again, clone, rate)
    made = runs(MlflowClient(f"sqlite:///{tmp_path}/mlflow.db"))
    found = {run.data.params["lr"]: (run.info.run_name, run.info.status) for run in made}
    assert found == {"1": ("ours.s0 (earlier)", "KILLED"), "2": ("ours.s0", "RUNNING"), "3": ("ours.s0", "RUNNING")}


def test_connect_says_that_a_clone_was_moved(empty_store, tmp_path, capfd):
    """Artifacts would be written to the old place."""
    (tmp_path / "old").mkdir()
    shutil.copy(empty_store, tmp_path / "old" / "mlflow.db")
    in_folder(tmp_path / "old", train_again, "here", 1)
    (tmp_path / "old").rename(tmp_path / "new")
    with chdir(tmp_path / "new"), pytest.raises(UserError, match=r"old/mlruns is gone.*track\.experiment"):
        store.connect(Track(f"sqlite:///{tmp_path}/new/mlflow.db", "test"))
    assert not (tmp_path / "old").exists()
    store.connect(Track(f"sqlite:///{tmp_path}/new/mlflow.db", "other"))


def test_without_an_address_nothing_is_tracked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    network = tmp_path / "ours.s0.safetensors"
    with training_run(tracking(None), "ours.s0", "1" * 64, {"lr": 1}) as run:
        assert run is None
    log_scores(tracking(None), network, "test", network)
    log_report(tracking(None), [network], [network], network)
    assert not list(tmp_path.iterdir()) and capsys.readouterr() == ("", "")


def test_serve_is_one_server_that_ends_with_it_and_takes_runs(tmp_path):
    """`relight ui` takes overrides and says where the runs are; by http, trainings are recorded, too."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["ui", f"track.uri=sqlite:///{tmp_path}/a.db", "track.experiment=test", "--port", str(port)]
    command = [sys.executable, "-m", "relight.cli", *words]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        line, address = server.stdout.readline(), f"http://127.0.0.1:{port}"
        assert line.startswith(f"MLflow: {address}/#/experiments/1/runs")
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            try:
                urllib.request.urlopen(f"{address}/health").read()
                break
            except OSError:
                time.sleep(0.2)
        in_folder(tmp_path, record, address, LOSSES)
        check_record(address)
        family = [server.pid, *(child.pid for child in psutil.Process(server.pid).children(recursive=True))]
        assert len(family) <= 4, "one person looks"
    finally:
        server.send_signal(signal.SIGTERM)
        server.wait(timeout=60)
    assert not psutil.wait_procs([psutil.Process(pid) for pid in family if psutil.pid_exists(pid)], timeout=30)[1]
