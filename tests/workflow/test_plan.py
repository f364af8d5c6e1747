"""The plan that the Snakefile asks: figures, runs, settings of each rule."""

import copy
import json
import os
import re
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from relight.core.errors import UserError
from relight.lab.checks import check
from relight.lab.made import describe, finish
from relight.lab.plan import DATA, Plan
from relight.lab.record import compose_run, expand_sweep, from_config
from relight.learning.train import learning_rate
from relight.settings import CONF, ROOT, Train


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def plan_of(words: str, **rows: list[str]) -> Plan:
    return Plan(compose_run(words.split(), rows or None))


@pytest.mark.parametrize(("config", "overrides"), [
    ({"hydra": "scale=smoke figures.count=3"}, ["scale=smoke", "figures.count=3"]),
    ({"hydra": ["scale=smoke", "figures.count=3"]}, ["scale=smoke", "figures.count=3"]),
    ({"scale": "smoke", "hydra": "figures.count=3"}, ["scale=smoke", "figures.count=3"]),
    ({"scale": "smoke", "figures": {"count": 3}}, ["scale=smoke", "figures.count=3"]),
    ({"scale": "smoke", "experiment": ["one"], "align": {"table": None}, "figures.count": 3}, None),
])  # fmt: skip
def test_snakemake_config_is_overrides(config, overrides):
    record = from_config(config)
    assert overrides is None or record["overrides"] == overrides
    assert Plan(record).figures == ["g0000", "g0001", "g0002"]


def test_settings_that_snakemake_would_drop_are_refused(monkeypatch):
    """Of two words with one key Snakemake keeps the second, and nothing beside a record."""
    for words, config, says in (
        (
            "hydra=scale=smoke hydra=name=x",
            {"hydra": "name=x"},
            'two hydra: write --config scale=smoke hydra="name=mine"',
        ),
        ("scale=smoke --config name=x", {"name": "x"}, "two --config: write"),
    ):
        monkeypatch.setattr(sys, "argv", ["snakemake", "--config", *words.split()])
        with pytest.raises(UserError, match=f"Snakemake drops one of {says}"):
            from_config(config)
    record = compose_run(["scale=smoke"])
    assert from_config({**record, "job": {}}) == record
    with pytest.raises(UserError, match="hydra is given beside the record of a run, which has all settings"):
        from_config({**record, "hydra": "name=x"})


def test_a_record_that_is_older_than_a_setting_has_its_default():
    record = compose_run(["scale=smoke", "loss.albedo=0"])
    older, other = copy.deepcopy(record), copy.deepcopy(record)
    del older["settings"]["align"], older["settings"]["loss"]["albedo"]
    for row in older["rows"].values():
        del row["train"]["start"]
    assert from_config(older) == record
    other["settings"]["model"]["gone"] = 1
    with pytest.raises(UserError, match=r"is of another version of relight .*'gone'.*begin with relight run"):
        from_config(other)


def test_a_record_belongs_to_the_folder_of_its_name(monkeypatch):
    """A copy's would change the original."""
    record = compose_run(["scale=smoke"])
    monkeypatch.setattr(sys, "argv", ["snakemake", "--configfile", "results/smoke/run.yaml"])
    assert from_config(copy.deepcopy(record)) == record
    for words in (["--configfile", "results/other/run.yaml"], ["--configfile=results/other/run.yaml"]):
        monkeypatch.setattr(sys, "argv", ["snakemake", *words])
        with pytest.raises(UserError, match=r"other/run\.yaml is a copy of that of smoke: relight run name=other goes"):
            from_config(record)


PRESETS = sorted(path.stem for path in (CONF / "experiment").glob("*.yaml"))


def test_batches_are_tens_of_seeds():
    """Whatever else is in the plan, so that more figures leave those that are there as they are."""
    plan = plan_of("scale=smoke figures.first=8 figures.count=14")
    assert list(plan.batches) == ["g0000-g0009", "g0010-g0019", "g0020-g0029"]
    assert plan.batches["g0000-g0009"] == ["g0008", "g0009"] and len(plan.figures) == 14
    assert plan.map_names[2] == ["g0020", "g0021"]


def test_a_row_means_the_same_in_every_preset():
    rows: dict[str, list[str]] = {}
    for preset in PRESETS:
        written = yaml.safe_load((CONF / "experiment" / f"{preset}.yaml").read_text())
        for row, words in written["sweep"]["rows"].items():
            assert rows.setdefault(row, words) == words, (preset, row)


@pytest.mark.slow
@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_plans(preset):
    """Each run of each preset composes, and what its section needs is told."""
    plan = plan_of(f"scale=smoke experiment={preset}")
    assert list(plan.experiments) == [preset]
    found = json.loads(json.dumps(plan.described()))[preset]
    assert list(found["trainings"]) == found["rows"]
    assert set(found["scores"]) == set(found["usual"]) == {*found["rows"], ""}
    assert f"{plan.out}/{found['scores'][''][0]}" in plan.results_of(preset)


@pytest.mark.slow
def test_experiments_share_runs_and_keep_their_conditions():
    plan = plan_of("scale=smoke experiment=[table1,table2,sitting,unusual_lights,silhouette]")
    assert plan.scored.count("ours_full.s0") == 1
    found = plan.described()
    assert found["table1"]["scores"]["ours_full"] == ["evaluate/ours_full.s0.csv"]
    assert found["sitting"]["scores"]["ours_full"] == ["evaluate/sitting-test/ours_full.s0.csv"]
    assert found["sitting"]["usual"]["ours_full"] == ["evaluate/ours_full.s0.csv"]
    assert found["unusual_lights"]["scores"][""] == ["evaluate/test-unusual/baselines.csv"]


def test_a_run_goes_on_from_another_of_its_seed():
    plan = plan_of("scale=smoke experiment=self_supervised sweep.seeds=[0,3] sweep.only=[self_all]")
    assert plan.start("self_all.s3") == ["results/smoke/train/ours_full.s3.safetensors"]
    assert plan.start("ours_full.s0") == [] and plan.scored == ["self_all.s0", "self_all.s3"]


def test_the_weights_for_photos_are_trained_at_half_the_size_and_then_at_the_full_one():
    """One cosine goes over both; else they differ in size, steps and start alone."""
    plan = plan_of("experiment=photo")
    assert list(plan.trainings) == ["photo_half.s0", "photo.s0"] and plan.scored == ["photo.s0"]
    assert len(plan.figures) == 345 and sum(map(len, plan.map_names)) == 345 * 2 * 2  # outfits, views
    groups = [plan.settings(run) for run in plan.trainings]
    half, full = (Train(**group.pop("train"), device="cpu") for group in groups)
    assert groups[0] == groups[1] and plan.start("photo.s0") == ["results/photo/train/photo_half.s0.safetensors"]
    assert vars(half) == vars(full) | {"size": 128, "steps": half.steps, "span": half.span, "start": None}
    last, first = learning_rate(half, half.steps - 1), learning_rate(replace(full, warmup=0), 0)
    assert last == pytest.approx(first, rel=1e-3) and learning_rate(full, full.steps - 1) < 0.03 * full.lr


@pytest.mark.parametrize(("hydra", "message"), [
    ("sweep.only=[nobody]", "no row nobody"),
    ("sweep.only=[wide]", r'wide is in no experiment: "\+\+experiments=.*" makes one of it'),
    ("+sweep.rows.wide=['bake.rays=9']", "changes bake"),
    ("+sweep.rows.wide=['train.start=wide']", "is the row itself"),
    ("+sweep.rows.wide=['split.test=.5']", "changes split"),
    ("+sweep.rows.wide=['train.seed=1']", r"sweep.seeds=\[1\]"),
    ("train.seed=1", r"sweep.seeds=\[1\]"),
])  # fmt: skip
def test_impossible_plans(hydra, message):
    words = ["scale=smoke", "+sweep.rows.wide=[]", hydra.replace("+sweep", "sweep")]
    with pytest.raises(UserError, match=message) as error:
        Plan(compose_run(words))
    if advice := re.search('"(.*)"', str(error.value)):
        assert list(Plan(compose_run([*words, advice[1]])).experiments) == ["wide"]


@pytest.mark.parametrize(("words", "names"), [
    (["train.lr=1,2", "loss=min,full"], ["lr_1-loss_min", "lr_1-loss_full", "lr_2-loss_min", "lr_2-loss_full"]),
    (["model=glob(*)"], ["model_ours", "model_ours_plus", "model_sfsnet", "model_sfsnet_ao", "model_unet"]),
    (["loss=glob(no_*,exclude=*tv)"], ["loss_no_reconstruction", "loss_no_shading"]),
    (["train.epoch=range(1,3)"], ["epoch_1", "epoch_2"]),
    (["train.start=a/b,a.b,a_b"], ["start_a_b", "start_a.b", None]),
    (["train.start=" + 150 * "x" + ",y"], [None, "start_y"]),
])  # fmt: skip
def test_sweeps_are_named(words, names):
    runs = expand_sweep(words)[1]
    assert len(runs) == len(names)
    for name, wanted in zip(runs, names):
        assert name == wanted if wanted else re.fullmatch(r"start_[\w-]{6,94}", name)
    Plan(compose_run(["scale=smoke"], runs))


@pytest.mark.parametrize(("words", "row", "message"), [
    ("align.table=no.csv", None, "align.table: there is no file no.csv"),
    ("train.start=no.onnx", None, "row sfsnet_ao: train.start: there is no file no.onnx"),
    (f"train.start={ROOT}/README.md", None, "README.md is not a safetensors file"),
    ("model.order=3", None, "row sfsnet_ao has model.order=3, and the maps have bake.order=2"),
    ("", "train.color=photo", "row b has train.color=photo, and the baselines paper"),
    ("experiment=light_transfer ++sweep.rows.ours_full=['train.color=photo']", None, "row ours_full has"),
    ("train.color=photo bake.size=128", "train.size=64", "row b has train.size=64, .* bake.size=128"),
])  # fmt: skip
@pytest.mark.slow
def test_what_a_run_would_miss_later_is_told_before(words, row, message):
    with pytest.raises(UserError, match=message):
        check(plan_of(f"scale=smoke {words}", **({"a": [], "b": [row]} if row else {})))


@pytest.mark.slow
def test_axes_beside_the_names_of_scans_are_asked_for(tmp_path):
    for name in ("a.obj", "b.obj"):
        (tmp_path / name).touch()
    (tmp_path / "scans.csv").write_text("path,up\na.obj,+z\nb.obj,+z\n")
    words = ["scale=smoke", "figures=scans", f"figures.folder={tmp_path}"]
    with pytest.raises(UserError, match=r"scans\.csv has a column `up`.*give align\.table="):
        check(Plan(compose_run(words)))
    words.append(f"align.table={tmp_path}/scans.csv")
    check(Plan(compose_run(words)))
    (tmp_path / "scans.csv").write_text("path,up,use\na.obj,+z,\nb.obj,+z,\nc.obj,+z,no\n")
    check(Plan(compose_run(words)))
    (tmp_path / "axes.csv").write_text("name,up\nA,+z\n")
    with pytest.raises(UserError, match=r"axes\.csv names A, and no figure is called so"):
        check(Plan(compose_run([*words[:-1], f"align.table={tmp_path}/axes.csv"])))


@pytest.mark.parametrize("kind", ["figures=scans figures", "panoramas=folder panoramas"])
@pytest.mark.slow
def test_files_of_the_future_are_told(tmp_path, kind):
    """Snakemake would end their jobs: outputs are older than inputs."""
    (file := tmp_path / ("a.obj" if "scans" in kind else "a.hdr")).write_text("v 0 0 0\n")
    plan = Plan(compose_run([*f"scale=smoke {kind}.folder={tmp_path}".split()]))
    check(plan)
    os.utime(file, (time.time() + 3600,) * 2)
    with pytest.raises(UserError, match=f"{file.name} is dated in the future: correct this machine's clock"):
        check(plan)


def test_data_of_another_run():
    """They are inputs: what made them is not planned, and settings that would change them are refused."""

    def refused(plan: Plan, says: str) -> None:
        with pytest.raises(UserError, match=says):
            check(plan)

    refused(plan_of("scale=smoke data=a name=b"), "data=a: results/a has no data set yet: relight run name=a makes it")
    first, plan = plan_of("scale=smoke name=a"), plan_of("scale=smoke data=a name=b train.lr=0.1")
    first.write_record()
    maps, packed, lights = (f"results/a/{name}" for name in ("maps/g0000-g0009", *DATA))

    def make(output: str, inputs: list[str], **params: object) -> None:
        file = Path(output, "x.exr") if "maps" in output else Path(output)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(params))
        finish([output], describe("rule", params, inputs, output))

    def make_all(rays: int) -> None:
        make(maps, [], bake={**first.shared["bake"], "rays": rays})
        make(packed, [maps], names=first.map_names)

    make_all(rays=32)
    make(lights, [], lights=first.shared["lights"])
    check(plan)
    assert plan.map_names == first.map_names and plan.network("x") == "results/b/train/x.safetensors"
    told = r"results/a/packed\.\w+ has other figures: leave out figures\.count, or let relight run name=a make them"
    refused(plan_of("scale=smoke data=a name=b figures.count=3"), told)
    plan_of("scale=smoke name=a bake.rays=33").write_record()  # and is interrupted before anything is made
    check(plan)
    other = plan_of("scale=smoke data=a name=b bake.rays=33")
    refused(other, r"data=a has bake\.rays=32, and this run asks for 33: leave out one of the two")
    make(maps, [], bake={**first.shared["bake"], "rays": 33})  # and is interrupted after that
    refused(other, r"data=a: results/a/packed\.\w+ was made of another maps/g0000-g0009; relight run name=a makes")
    make_all(rays=33)
    check(other)
    Path(maps, "x.exr").unlink()
    refused(other, r"data=a: results/a/maps/g0000-g0009/x\.exr is missing; relight run name=a")
    shutil.rmtree("results/a/made")
    refused(other, "has no record of how it was made: remove it, and relight run name=a makes it anew")


def test_a_table_of_scans_belongs_to_scans(tmp_path):
    """Where figures are generated, a scans.csv in the current folder concerns nobody."""
    (tmp_path / "scans.csv").write_text("path\na.obj\n")
    (tmp_path / "a.obj").write_text("")
    assert plan_of("scale=smoke").table == []
    assert Plan(compose_run(["figures=scans", f"figures.folder={tmp_path}"])).table == [f"{tmp_path}/scans.csv"]


@pytest.mark.slow
def test_labels_are_those_of_the_experiment_s_own_file():
    plan = plan_of("scale=smoke experiment=[table2,silhouette] +experiments.table2.labels.ours_full=Mine")
    assert plan.labels(["no_tv", "ours_full", "silhouette"]) == ["w/o TV", "Mine", "Mask alone"]
    for labels, says in (
        ("+LABELS.nobody=Mine", r"experiments\.table2\.labels: no row nobody in experiments\.table2\.rows"),
        ("LABELS.no_tv=SfSNet LABELS.no_shading=SfSNet", "no_tv and no_shading have the same label, SfSNet: give one"),
    ):
        with pytest.raises(UserError, match=says):
            plan_of("scale=smoke experiment=table2 " + labels.replace("LABELS", "experiments.table2.labels"))
