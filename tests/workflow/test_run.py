"""`relight run` and the stages leave the record of another workflow alone, and nothing beside their outputs."""

import fcntl
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from relight import plan as plan_module
from relight import run as module
from relight.config import ROOT
from relight.config_folder import ConfigFolder
from relight.errors import UserError


@pytest.fixture
def calls(tmp_path, monkeypatch) -> list:
    """What Snakemake was called with, (its words, what its configuration file held), in a repository of its own."""
    found = []

    def snakemake(words, **streams):
        file = Path(words[words.index("--configfile") + 1])
        found.append((words, yaml.safe_load(file.read_text()), file))
        return 1

    monkeypatch.setattr(module, "snakemake", snakemake)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    for name in ("config_folder", "rows"):
        monkeypatch.setattr(f"relight.{name}.ROOT", tmp_path)
    monkeypatch.setattr(module, "LOCK", tmp_path / ".snakemake" / "relight.lock")
    return found


WORDS = ["scale=smoke", "experiment=one"]


def run(*overrides: str, dry: bool = False) -> int:
    return module.run([*WORDS, *overrides], False, None, dry, ["all"], [])


def test_a_dry_run_leaves_the_record_alone(calls, tmp_path):
    record = tmp_path / "results" / "smoke" / "run.yaml"
    run("train.lr=0.1")
    assert calls[0][2] == record
    run("train.lr=0.2", dry=True)
    assert "--dry-run" in calls[1][0] and calls[1][1] == {"hydra": [*WORDS, "train.lr=0.2"]}
    assert yaml.safe_load(record.read_text()) == {"hydra": [*WORDS, "train.lr=0.1"]}
    assert calls[1][2] != record and not calls[1][2].exists()


def test_the_record_is_of_the_workflow_that_holds_the_folder(calls, tmp_path):
    run("train.lr=0.1")
    with open(module.LOCK, "w") as holder:
        fcntl.flock(holder, fcntl.LOCK_EX)
        with pytest.raises(UserError, match="another `relight run`"):
            run("train.lr=0.2")
    record = yaml.safe_load((tmp_path / "results" / "smoke" / "run.yaml").read_text())
    assert record["hydra"][-1] == "train.lr=0.1" and len(calls) == 1


def test_results_of_a_clock_that_was_ahead_are_dated_now(calls, tmp_path):
    """Snakemake ends a job whose outputs are older than its inputs."""
    maps = tmp_path / "results" / "smoke" / "maps"
    maps.mkdir(parents=True)
    for name, ahead in (("early", -3600), ("late", 3600)):
        (maps / name).write_text("")
        os.utime(maps / name, (time.time() + ahead,) * 2)
    before = time.time()
    run()
    dates = {name: (maps / name).stat().st_mtime for name in ("early", "late")}
    assert dates["early"] < before - 3000 and before <= dates["late"] <= time.time()


@pytest.mark.parametrize("changed", [False, True])
def test_remove_outdated_of_experiments_that_are_not_in_the_run(tmp_path, changed):
    """As after a sweep under the name of earlier results: their tables stay unless the data set has changed since."""
    from relight.evaluation.report.build import remove_outdated

    report, ends = tmp_path / "report", (".csv", ".md", ".tex")
    report.mkdir()
    planned = {f"{name}{end}" for name in ("table1", "table1_occlusion", "light_transfer") for end in ends}
    others = {"order_plates.png", *(f"order{end}" for end in ends)}
    kept = planned | {"occlusion.csv", "notes.md", "table1_plates.png"}
    for name in kept | others:
        (report / name).write_text("")
        os.utime(report / name, (1000, 1000))
    (tmp_path / "packed.safetensors").write_text("")
    os.utime(tmp_path / "packed.safetensors", (2000 if changed else 500,) * 2)
    experiments = {"table1": {}, "light_transfer": {}}
    remove_outdated(SimpleNamespace(folder=tmp_path, report=report, experiments=experiments))
    assert {path.name for path in report.iterdir()} == kept | (set() if changed else others)


@pytest.mark.slow
def test_a_sweep_of_a_stage_leaves_its_outputs_alone(tmp_path):
    (tmp_path / "record.json").write_text(json.dumps({"figures": {}}))
    words = ["-m", "split.seed=1,2", "io.packed=none", "io.record=record.json", "io.out=out"]
    command = [sys.executable, "-m", "relight.stages.split", *words]
    stage = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert "there is no file none" in stage.stderr and "Traceback" not in stage.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["record.json"]


class Again:
    """Stands for `subprocess` in relight.plan: notes what Snakemake is called with, and says that it succeeded."""

    def __init__(self):
        self.calls = []

    def run(self, command, env, **_):
        self.calls.append((command, json.loads(env[plan_module.FAILED_VARIABLE])))
        return subprocess.CompletedProcess(command, 0)


@pytest.mark.slow
def test_what_failed_leaves_the_report_of_the_others(tmp_path, monkeypatch, capsys):
    """Only light_transfer has no results: Snakemake is called again without it, as it was called by whomever."""
    monkeypatch.chdir(tmp_path)
    again = Again()
    monkeypatch.setattr(plan_module, "subprocess", again)
    config = {"hydra": "scale=smoke experiment=[table1,light_transfer] sweep.only=[sfsnet,ours_full]"}
    plan = plan_module.Plan(config)
    plan_module.report_completed(plan)
    assert not again.calls, "nothing is there: nothing to report"
    wanted = [*plan.score_files, *(plan.network(training) for training in plan.scored)]
    wanted += [f"{plan.out}/{path}" for path in ("packed.safetensors", "figures.json", "lights/lights.npz")]
    for path in wanted:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("")
    plan_module.report_completed(plan)
    failed = {"light_transfer": [f"{plan.out}/light_transfer/{name}" for name in ("scores.csv", "plate.png")]}
    assert again.calls == [([*sys.orig_argv, "--nolock"], failed)]
    assert "failed: light_transfer" in capsys.readouterr().err
    without = plan_module.Plan(config, failed)
    assert list(without.experiments) == ["table1"] and without.tables == ["table1"]
    found = json.loads(ConfigFolder(without).experiments_json())
    assert found["light_transfer"]["failed"] == failed["light_transfer"] and "scores" in found["table1"]
    plan_module.report_completed(without)
    assert len(again.calls) == 1, "a report of the others that fails is not tried again"


def test_what_a_killed_run_left_at_work_is_ended(tmp_path, monkeypatch):
    """And nothing else: not a stage that someone started by hand in the same folder."""
    monkeypatch.setattr(module, "ROOT", tmp_path)
    program = "import time; print('here', flush=True); time.sleep(300)"
    environments = {"job": {module.RUN_VARIABLE: "1"}, "own": {}, "snakemake": {}}
    started = {}
    try:
        for name, marks in environments.items():
            words = [sys.executable, "-c", program, "relight.stages.train"]
            if name == "snakemake":
                (tmp_path / "snakemake").write_text(program)
                words = [sys.executable, "snakemake"]
            started[name] = subprocess.Popen(words, cwd=tmp_path, env=marks, stdout=subprocess.PIPE)
            assert started[name].stdout.readline() == b"here\n"
        with pytest.raises(UserError, match=rf"process {started['snakemake'].pid}"):
            module.kill_orphans()
        started["snakemake"].kill()
        started["snakemake"].wait()
        module.kill_orphans()
        assert started["job"].poll() is not None and started["own"].poll() is None
    finally:
        for process in started.values():
            process.kill()
            process.wait()
            process.stdout.close()


@pytest.mark.slow
def test_a_job_takes_lists_of_files_and_its_log_says_what_it_was(tmp_path):
    """As the workflow calls it: the settings, versions and command are lines that begin with "# "."""
    from relight.meshes import Mesh
    from relight.stages.step import left_out

    for name in ("a", "b"):
        left_out({"name": name}, f"{name} is no figure").save(tmp_path / f"{name}.npz")
    words = ["io.mesh=[a.npz,b.npz]", "io.out=[c.npz,d.npz]", "clean.close_holes=7"]
    command = [sys.executable, "-m", "relight.stages.clean", *words]
    environment = {"PYTHONPATH": str(ROOT), "RELIGHT_SNAKEMAKE": str(os.getpid())}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    made = [Mesh.load(tmp_path / f"{name}.npz").info["left_out"] for name in ("c", "d")]
    assert made == ["a is no figure", "b is no figure"]
    lines = done.stdout.splitlines()
    assert all(line.startswith("# ") for line in lines)
    assert "relight" in lines[1] and "numpy" in lines[1] and "io.mesh=[a.npz,b.npz]" in lines[2]
    assert yaml.safe_load("\n".join(line[2:] for line in lines[3:]))["clean"]["close_holes"] == 7
    words[1] = "io.out=[c.npz]"
    wrong = subprocess.run([*command[:3], *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert wrong.returncode == 1 and "equally long: io.mesh, io.out" in wrong.stderr


def test_a_sweep_tells_its_runs_once(calls, capsys):
    module.run(["scale=smoke", "train.lr=0.1,0.2"], True, None, True, ["all"], [])
    assert capsys.readouterr().out == "lr_0.1: train.lr=0.1\nlr_0.2: train.lr=0.2\n"


def test_one_figure_is_refused_before_anything_runs(calls):
    with pytest.raises(UserError, match=r"at least two figures, and there is only g0000: `relight bake"):
        run("figures.count=1")
    assert module.run([*WORDS, "figures.count=1"], False, None, True, ["bake"], []) == 1
    assert len(calls) == 1
