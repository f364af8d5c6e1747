"""`relight run` leaves the record of another workflow alone, tells what has changed, and reports what is complete."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from relight import cli
from relight.core.errors import UserError
from relight.lab import run as module
from relight.lab.checks import changes, check_figures
from relight.lab.made import describe, finish
from relight.lab.plan import DATA, Plan
from relight.lab.record import compose_run


@pytest.fixture
def calls(tmp_path, monkeypatch) -> list:
    """What Snakemake was called with, (its words, what its configuration file held), in a repository of its own."""
    found = []

    def snakemake(words, held=()):
        file = Path(words[words.index("--configfile") + 1])
        found.append((words, yaml.safe_load(file.read_text()), file))
        if held:  # a second run that begins now
            with pytest.raises(UserError, match="another workflow is making"):
                module.hold(file.parent)
        return 1

    def dry(words, **_):
        table = "Job stats:\ntotal 22\n\n"
        return SimpleNamespace(returncode=snakemake(words), stdout=f"Building\n{table}{table}Reasons:\n")

    monkeypatch.setattr(module, "snakemake", snakemake)
    monkeypatch.setattr(module.subprocess, "run", dry)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.chdir(tmp_path)
    return found


WORDS = ["scale=smoke", "experiment=one"]


def run(*overrides: str, dry: bool = False) -> int:
    return module.run([*WORDS, *overrides], False, None, dry, ["all"], [])


def test_a_dry_run_leaves_the_record_alone_and_has_one_table(calls, tmp_path, capsys):
    record = Path("results", "smoke", "run.yaml")
    run("train.lr=0.1")
    assert calls[0][2] == record
    run("train.lr=0.2", dry=True)
    assert capsys.readouterr().out.endswith("Building\nJob stats:\ntotal 22\n\nReasons:\n")
    assert json.dumps(calls[1][1]["settings"]["figures"]) == json.dumps(calls[0][1]["settings"]["figures"])  # in order
    assert "--dry-run" in calls[1][0] and calls[1][1]["settings"]["train"]["lr"] == 0.2
    assert yaml.safe_load(record.read_text())["overrides"] == [*WORDS, "train.lr=0.1"]
    assert calls[1][2] != record and not calls[1][2].exists()


def test_results_are_made_by_one_workflow(calls, tmp_path):
    """The lock is of the results, and ends with the process that holds it; another name has its own."""
    run("train.lr=0.1")
    handle = module.hold(tmp_path / "results" / "smoke")
    with pytest.raises(UserError, match=r"another workflow is making .*results/smoke: wait for it, or end it"):
        run("train.lr=0.2")
    run("name=other")
    assert len(calls) == 2
    record = yaml.safe_load((tmp_path / "results" / "smoke" / "run.yaml").read_text())
    assert record["settings"]["train"]["lr"] == 0.1
    os.close(handle)
    run("train.lr=0.2")
    assert len(calls) == 3


def test_data_that_another_run_takes_are_not_made_meanwhile(calls, tmp_path):
    """Several runs may take them at once."""
    run("name=a")
    for file in [f"results/a/{name}" for name in DATA]:
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).touch()
        finish([file], describe("rule", {"names": Plan(compose_run(WORDS)).map_names}, [], file))
    handle = module.hold(tmp_path / "results" / "a")
    with pytest.raises(UserError, match=r"another workflow is making .*results/a: wait for it, or end it"):
        run("name=b", "data=a")
    os.close(handle)
    handle = module.hold(tmp_path / "results" / "a", shared=True)
    run("name=b", "data=a")
    with pytest.raises(UserError, match=r"another workflow is making .*results/a: wait for it, or end it"):
        run("name=a", "bake.rays=64")
    assert len(calls) == 2 and (tmp_path / "results" / "a" / "packed.safetensors").exists()
    os.close(handle)
    run("name=a")
    assert len(calls) == 3


def test_settings_with_dashes_are_told():
    with pytest.raises(UserError, match="--experiment: a setting has no dashes and an equals sign, experiment="):
        cli.app(["run", "-n", "--experiment", "table1"])


def test_a_target_is_a_rule_or_a_file(calls):
    module.run(WORDS, False, None, False, ["bake", "results/smoke/lights/lights.npz"], [])
    assert " ".join(calls[0][0]).split("snakemake ")[1].startswith("results/smoke/lights/lights.npz --quiet")
    assert "--until bake --configfile" in " ".join(calls[0][0])
    for rule in ("bakee", "scan"):
        with pytest.raises(UserError, match=f"{rule} is neither a file nor a rule of this run: align"):
            module.run(WORDS, False, None, False, [rule], [])


def test_a_gpu_that_is_not_there_is_told_before_the_figures(calls, monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(UserError, match=r"train\.device=cuda, but torch finds no GPU"):
        run("train.device=cuda")
    cluster = [*WORDS, "train.device=cuda"], False, None, False, ["all"], ["--profile", "profiles/slurm"]
    monkeypatch.setitem(sys.modules, "snakemake_executor_plugin_slurm", None)
    with pytest.raises(ModuleNotFoundError):  # the command names the extra
        module.run(*cluster)
    monkeypatch.setitem(sys.modules, "snakemake_executor_plugin_slurm", module)
    module.run(*cluster)
    assert len(calls) == 1 and "gpu=1" not in calls[0][0]


@pytest.mark.parametrize("device", ["cuda", "auto"])
def test_a_gpu_trains_one_network_at_a_time(calls, monkeypatch, device):
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr(module, "which", str)
    run(f"train.device={device}")
    run("train.device=cpu")
    module.run([*WORDS, f"train.device={device}"], False, None, False, ["all"], ["--resources", "gpu=2"])
    resources = ["--resources gpu=1 --set-resources train:gpu=1" in " ".join(c[0]) for c in calls]
    assert resources == [True, False, False]


def test_changed_settings_are_told_with_the_way_to_keep_both(calls):
    """Those that results were made with, whatever run.yaml says."""
    run()
    plan = Plan(compose_run(WORDS))
    for file, rule, params in (
        (f"{plan.out}/{DATA[0]}", "bake", {"bake": plan.shared["bake"]}),
        (plan.network("run.s0"), "train", {"settings": plan.settings("run.s0")}),
    ):
        (path := Path(file)).parent.mkdir(exist_ok=True)
        path.touch()
        finish([file], describe(rule, params, [], file))
    assert not [*changes(plan)]
    for _ in range(2):
        run(*(words := ["bake.rays=64", "train.lr=0.5", "train.device=cpu", "track.experiment=other"]))
        (line,) = changes(Plan(compose_run([*WORDS, *words])))
        assert line.startswith("results/smoke was made with other settings (bake.rays, train.lr): what depends on them")
        assert line.endswith("is outdated; to keep both, give this run a name, name=NAME")
    assert not [*changes(plan)]


def test_tables_of_earlier_experiments_are_told_when_they_are_outdated(calls):
    run("experiment=table1")
    plan = Plan(compose_run([*WORDS, "experiment=table1"]))
    packed, scores, table = (f"{plan.out}/{name}" for name in (DATA[0], "evaluate/x.csv", "report/table1.md"))

    def make(file: str, text: str, inputs: list[str], **params: object) -> None:
        (path := Path(file)).parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        finish([file], describe("rule", params, inputs, file))

    make(packed, "1", [], bake=plan.shared["bake"])
    make(scores, "1", [packed])
    make(table, "1", [scores], name="other", experiments={"one": {"rows": []}})
    other, told = Plan(compose_run([*WORDS, "bake.rays=64"])), "keeps tables of other settings, data or code, of"
    assert not [*changes(Plan(compose_run(WORDS)))]
    assert [line for line in changes(other) if told in line] == [f"{plan.out}/report {told} experiment=[table1]"]
    make(packed, "2", [], bake=other.shared["bake"])
    assert [*changes(other)] == [f"{plan.out}/report {told} experiment=[table1]"]
    assert not [line for line in changes(plan) if told in line], "which makes it again"


def test_a_name_remembers_its_run(calls, capsys):
    """What is given again counts; another word for its data would mix the maps of both."""
    module.run([*WORDS, "name=mine", "panoramas.count=25"], False, None, False, ["all"], [])
    capsys.readouterr()
    module.run(["name=mine", "train.lr=0.1"], False, None, False, ["all"], [])
    assert capsys.readouterr().out.startswith("goes on with scale=smoke experiment=one panoramas.count=25\n")
    settings = calls[-1][1]["settings"]
    assert (settings["panoramas"]["count"], settings["train"]["lr"], settings["train"]["steps"]) == (25, 0.1, 24)
    module.run(["name=mine", "panoramas.count=26"], False, None, False, ["all"], [])
    told = "scale=smoke experiment=one train.lr=0.1 name=mine panoramas.count=26"
    assert calls[-1][1]["overrides"] == told.split()


@pytest.mark.parametrize("words", ["loss=full", "model=unet", "experiment=table2 model=ours_plus"])
def test_a_setting_that_each_row_has_is_refused(calls, words):
    """No row of the experiment would change: they are those of the run without it."""
    *others, last = words.split()
    assert compose_run([*others, last])["rows"] == compose_run(others)["rows"]
    with pytest.raises(UserError, match=f"{last} has no effect, since each row has its own {last.partition('=')[0]}"):
        module.run(words.split(), False, None, False, ["all"], [])
    module.run(["experiment=one", "name=mine", last], False, None, False, ["all"], [])
    module.run(["experiment=table2", "name=mine"], False, None, False, ["all"], [])  # of a word that it remembers


def test_a_name_remembers_its_sweep(calls):
    module.run([*WORDS, "name=mine", "train.lr=1e-4,2e-4"], True, None, False, ["all"], [])
    for words in (["train.steps=7"], ["experiment=one"]):
        module.run(["name=mine", *words], False, None, True, ["all"], [])
    assert [[*rows] for rows in (call[1]["rows"] for call in calls)] == [["lr_0.0001", "lr_0.0002"]] * 2 + [["run"]]
    assert calls[1][1]["rows"]["lr_0.0002"]["train"]["steps"] == 7


def test_results_of_other_people_are_not_mixed(calls, tmp_path):
    for name in ("a.obj", "b.obj", "other/a.obj", "other/b.obj"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    run("name=mine", "figures=scans", f"figures.folder={tmp_path}")
    with pytest.raises(UserError, match=r"results/mine was made with figures\.folder=.*: give this run a name"):
        run("name=mine", f"figures.folder={tmp_path / 'other'}")
    assert len(calls) == 1


def test_a_path_in_other_words_is_the_same(calls, tmp_path, capsys):
    """And stays as it was written, since the rules see the words."""
    for name in ("a.obj", "b.obj"):
        (tmp_path / name).touch()
    before = []
    for folder in (".", tmp_path, f"../{tmp_path.name}/"):
        module.run([*WORDS, "name=mine", "figures=scans", f"figures.folder={folder}"], False, None, False, ["all"], [])
        before.append(calls[-1][1]["settings"]["figures"])
    assert before[0]["folder"] == "." and before == 3 * before[:1] and not capsys.readouterr().out


def test_what_failed_leaves_the_report_of_the_others(calls, capsys):
    """Only sitting has no results: Snakemake is called again without it."""
    words = ["scale=smoke", "experiment=[table1,sitting]", "sweep.only=[sfsnet,ours_full]"]
    assert module.run(words, False, None, False, ["all"], []) == 1
    assert len(calls) == 1, "nothing is there: nothing to report"
    plan = Plan(compose_run(words))
    wanted = [*plan.results_of("table1"), *map(plan.network, plan.trainings)]
    wanted += [f"{plan.out}/{path}" for path in ("packed.safetensors", "figures.json", "lights/lights.npz")]
    for path in map(Path, wanted):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    assert module.run(words, False, None, False, ["all"], []) == 1
    failed = {"sitting": [f"{plan.out}/evaluate/sitting-test/{name}.csv" for name in ("ours_full.s0", "baselines")]}
    assert "failed" not in calls[1][1] and calls[2][1]["failed"] == failed and len(calls) == 3
    assert "failed: sitting" in capsys.readouterr().err
    assert "failed" not in yaml.safe_load(calls[2][2].read_text()), "all is tried again"
    without = Plan(calls[2][1])
    assert list(without.experiments) == ["table1"]
    found = without.described()
    assert found["sitting"]["failed"] == failed["sitting"] and "scores" in found["table1"]


def test_one_figure_or_person_is_refused_before_anything_runs(calls, tmp_path):
    for number in range(3):
        (tmp_path / "eve" / f"{number:04d}").mkdir(parents=True)
        (tmp_path / "eve" / f"{number:04d}" / "scan.obj").touch()
    for words, says in (
        (["figures.count=1"], "at least two figures, and there is only g0000: `relight bake"),
        (["figures=scans", f"figures.folder={tmp_path}"], "all 3 scans have the subject eve, and a split by subject"),
        (["figures.per_subject=6"], "figures.per_subject=6 makes one person of all 6 figures"),
        (["figures.per_subject=12", "figures.first=14"], "figures.per_subject=12 makes one person"),
        (["figures.sitting=1"], "all figures sit"),
        (["figures.garments=[tiara]"], "tiara"),
        (["figures.poses=[nope]"], "nope"),
    ):
        with pytest.raises(UserError, match=says):
            run(*words)
    for words in (["figures.per_subject=5"], ["figures.per_subject=6", "figures.first=3"],
                  ["figures.per_subject=6", "split=paper"], ["figures.sitting=1", "split.sitting=dealt"],
                  ["figures=scans", f"figures.folder={tmp_path}", "split=paper"]):  # fmt: skip
        check_figures(Plan(compose_run([*WORDS, *words])))
    assert not calls
    assert module.run([*WORDS, "figures.count=1"], False, None, True, ["bake"], []) == 1 and len(calls) == 1


@pytest.mark.slow
def test_a_clone_may_have_any_name(done, tmp_path):
    """Snakemake pastes the path of Python and the names of files into commands."""
    (repo := tmp_path / "a b'ü %").mkdir()
    for path in done.iterdir():
        if path.name not in (".snakemake", "results", "mlruns", "mlflow.db"):
            (repo / path.name).symlink_to(path)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", repo / "v"], check=True)
    site = next((repo / "v" / "lib").glob("python*/site-packages"))
    (site / "all.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    target = "results/smoke/lights/lights.npz"
    words = ["-m", "snakemake", target, "--config", "scale=smoke", "--cores", "1", "--directory", str(repo)]
    made = subprocess.run([repo / "v" / "bin" / "python", *words], cwd=repo, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert (repo / target).exists()
