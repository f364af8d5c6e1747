"""`relight run` and the stages leave the record of another workflow alone, and nothing beside their outputs."""

import fcntl
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from relight import run as module
from relight.config import ROOT
from relight.files import UserError


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


def test_tables_of_other_experiments_leave_the_report(tmp_path, monkeypatch):
    from relight.evaluation.report import results, sections
    from relight.stages.tables import main

    class Results:
        tables = ("table1",)

        def __init__(self, *_):
            self.table = self.title = lambda name: name

    ends = (".csv", ".md", ".tex")
    monkeypatch.setattr(results, "Results", Results)
    monkeypatch.setattr(
        sections, "write_score_table", lambda table, title, out: [Path(f"{out}{end}").write_text("") for end in ends]
    )
    kept = {"occlusion.csv", "notes.md", "table1_plates.png"}
    for name in (*kept, "order_plates.png", *(f"order{end}" for end in ends)):
        (tmp_path / name).write_text("")
    main(None, tmp_path, tmp_path, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept | {f"table1{end}" for end in ends}


def test_a_sweep_of_a_stage_leaves_its_outputs_alone(tmp_path):
    (tmp_path / "record.json").write_text(json.dumps({"figures": {}}))
    words = ["-m", "split.seed=1,2", "io.packed=none", "io.record=record.json", "io.out=out"]
    command = [sys.executable, "-m", "relight.stages.split", *words]
    stage = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert "there is no file none" in stage.stderr and "Traceback" not in stage.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["record.json"]


def test_what_failed_leaves_the_report_of_the_others(calls, tmp_path, monkeypatch, capsys):
    """Only inference_time has no results: its section is left out in a second call, and the first code is kept."""
    words = ("experiment=[table1,inference_time]", "sweep.only=[sfsnet,ours_full]")
    plan = module.Plan({"hydra": ["scale=smoke", *words]})
    wanted = [*plan.score_files, *(plan.network(run) for run in plan.scored)]
    wanted += [f"{plan.out}/{path}" for path in ("packed.safetensors", "figures.json", "lights/lights.npz")]

    def snakemake(command, **streams):
        file = Path(command[command.index("--configfile") + 1])
        calls.append(yaml.safe_load(file.read_text()))
        return int(len(calls) == 1)

    monkeypatch.setattr(module, "snakemake", snakemake)
    assert run(*words) == 1 and len(calls) == 1  # nothing is there: nothing to report
    for path in wanted:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("")
    calls.clear()
    assert run(*words) == 1
    failed = {"inference_time": [f"{plan.out}/inference_time/ours_full.s0.csv"]}
    assert [call.get("failed") for call in calls] == [None, failed]
    assert not (tmp_path / plan.out / "failed.yaml").exists() and "failed: inference_time" in capsys.readouterr().err
    without = module.Plan(calls[1])
    assert list(without.experiments) == ["table1"] and without.tables == ["table1"]
    asked = json.loads(without.questions())
    assert asked["inference_time"]["failed"] == failed["inference_time"] and "scores" in asked["table1"]


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
