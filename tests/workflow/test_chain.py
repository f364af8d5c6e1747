"""The whole workflow at its smallest, from seeds to the report, and what re-runs."""

import csv
import hashlib
import json
import math
import os
import re
import runpy
import shutil
import sys
import time

import mlflow
import numpy as np
import pytest
import torch
from repo import OUT, ROOT, WORDS, copy, hashes, output, planned, relight

from relight.lab.run import hold
from relight.learning.checkpoint import load_network
from relight.learning.export import PhotoGraph, sample_inputs

pytestmark = pytest.mark.slow


def test_the_report_has_numbers_and_pictures_on_one_page(done):
    with open(done / OUT / "report" / "self_supervised.csv", newline="") as file:
        table = {row["row"]: row for row in csv.DictReader(file)}
    for name in ("ours_full", "self_all"):
        assert math.isfinite(float(table[name]["shading_rmse"])) and float(table[name]["shading_rmse"]) > 0
    assert (done / OUT / "report" / "self_supervised.md").stat().st_size > 500
    page = (done / OUT / "report" / "report.html").read_text()
    assert page.count("data:image/") >= 5
    assert 'href="viewer.html"' in page and (done / OUT / "report" / "viewer.html").stat().st_size > 50_000
    assert 'id="self_supervised"' in page and 'class="failed"' not in page
    assert "http://" not in page.replace("http://www.w3.org", "") and "<script src" not in page


def test_a_network_becomes_the_weights_of_photos(done, tmp_path):
    make = runpy.run_path(str(ROOT / "tools" / "weights.py"))["main"]
    make.__globals__.update(OUT=tmp_path, export=lambda network, path, header: path.write_text(json.dumps(header)))
    make(done / OUT, "ours_full.s0")
    header = json.loads((tmp_path / "photo.onnx").read_text())
    assert header["train"]["start"] is None and [stage["steps"] for stage in header["stages"]] == [24]
    assert len(header["lights"]) % 27 == 0 and np.isfinite(header["lights"]).all()
    assert "| held out | 1 figures, 2 lights |" in (tmp_path / "README.md").read_text()


def test_a_network_is_a_model_that_mlflow_loads(done):
    """By address and by search, with a signature and an example; it infers what the network does."""
    mlflow.set_tracking_uri(f"sqlite:///{done}/mlflow.db")
    experiment = mlflow.get_experiment_by_name("smoke").experiment_id
    (run,) = mlflow.search_runs([experiment], "attributes.run_name = 'ours_full.s0'", output_format="list")
    model = mlflow.pyfunc.load_model(f"runs:/{run.info.run_id}/network")
    models = {found.model_id: found for found in mlflow.search_logged_models([experiment], output_format="list")}
    for tags in (run.data.tags, models[model.model_id].tags):
        assert tags["mlflow.source.name"] == "relight run"
    inputs = [str(value) for value in model.metadata.signature.inputs]
    assert inputs == ["'image': Tensor('float32', (-1, 3, -1, -1))", "'mask': Tensor('float32', (-1, 1, -1, -1))"]
    assert [value.name for value in model.metadata.signature.outputs] == ["albedo", "transport", "light"]
    expected = PhotoGraph(load_network(done / OUT / "train" / "ours_full.s0.safetensors")[0])
    for given in (model.input_example, dict(zip(["image", "mask"], (x.numpy() for x in sample_inputs(3, 128, 192))))):
        with torch.inference_mode():
            wanted = expected(*map(torch.from_numpy, given.values()))
        for a, b in zip(model.predict(given).values(), wanted, strict=True):
            np.testing.assert_allclose(a, b, atol=5e-3)


def test_a_second_run_does_nothing(done):
    run = relight(done, "run", *WORDS)
    assert run.returncode == 0 and "Nothing to be done" in run.stdout


AFTER_TRAINING = {"evaluate": 2, "plates": 1, "report": 1, "viewer": 1}
AFTER_SPLIT = {"train": 2, **AFTER_TRAINING, "evaluate": 3}
AFTER_BAKING = {"pack": 1, "split": 1, "sheets": 1, **AFTER_SPLIT}
AFTER_LIGHTS = {"sheets": 1, **AFTER_SPLIT}
CHANGES = {
    "track.experiment=other": {},
    "train.device=cpu": {},
    "split.least=0.4": {},
    "train.lr=0.5": {"train": 2, **AFTER_TRAINING},
    "augment.camera=0": {},
    "split.seed=1": {"split": 1, **AFTER_SPLIT},
    "bake.rays=8": {"bake": 1, **AFTER_BAKING},
    "align.up=+y": {"clean": 1, "align": 1, "bake": 1, **AFTER_BAKING},
    "figures.sitting=0.5": {"figure": 1, "clean": 1, "align": 1, "bake": 1, **AFTER_BAKING},
    "lights.clusters=5": {"lights": 1, **AFTER_LIGHTS},
    # One more network, on the usual figures and lights; and the same network under lights of an experiment's own.
    "experiment=table2 sweep.only=[ours_full,no_tv]": {"train": 1, "evaluate": 1, "report": 1, "viewer": 1},
    "experiment=unusual_lights sweep.only=[ours_full]": {"evaluate": 2, "plates": 1, "report": 1, "viewer": 1},
}


# A file and the text that is added to it -> what is done again.
EDITS = {
    ("relight/learning/losses.py", "X = 1\n"): {"train": 2, **AFTER_TRAINING},
    ("relight/transport/integrate.py", "# A comment.\n"): {},
    ("relight/meshes/gltf.py", "X = 1\n"): {},
    ("relight/settings/scores.py", "READINGS['ssim'] = Reading('SSIM', 1)\n"): {"report": 1},
    ("relight/settings/scores.py", "QUANTITIES['ao'] = Quantity('AO', 2)\n"): {"evaluate": 3, "report": 1},
    ("workflow/scripts/clean.py", "X = 1\n"): {"clean": 1, "align": 1, "bake": 1, **AFTER_BAKING},
    ("workflow/scripts/lights.py", "X = 1\n"): {"lights": 1, **AFTER_LIGHTS},
    ("workflow/rules/lights.smk", "        more=1,\n"): {"lights": 1, **AFTER_LIGHTS},
}


# Rule -> packages of relight on which its results depend.
PACKAGES = {
    "figure": "core figures meshes",
    "clean": "core meshes",
    "align": "core maps meshes sh",
    "bake": "core maps meshes sh transport",
    "pack": "core maps sh",
    "split": "core learning maps sh",
    "lights": "core lights panoramas pictures sh",
    "train": "core lab learning lights maps panoramas photos sh",
    "evaluate": "core evaluation learning lights maps panoramas photos sh",
}


def test_a_rule_depends_on_its_packages_alone(done):
    """By the modules that its jobs have imported, as the records name them."""
    found = {}
    for file in (done / OUT / "made").rglob("*.json"):
        record = json.loads(file.read_text())
        assert f"workflow.scripts.{record['rule']}" in record["code"] and "relight.meshes.read" not in record["code"]
        packages = {name.split(".")[1] for name in record["code"] if name.startswith("relight.")}
        found.setdefault(record["rule"], set()).update(packages)
    assert {rule: " ".join(sorted(found[rule])) for rule in PACKAGES} == PACKAGES


def test_changed_settings_or_code_run_what_they_touch(done, tmp_path):
    """By Snakemake alone, without `relight run`."""
    given = {word.partition("=")[0]: word for word in WORDS}
    changed = [{word.partition("=")[0]: word for word in change.split()} for change in CHANGES]
    assert dict(zip(CHANGES, planned(done, *([*(given | words).values()] for words in changed)))) == CHANGES
    repo = tmp_path / "repo"
    shutil.copytree(done, repo, ignore=shutil.ignore_patterns("mlruns"))
    assert dict(zip(EDITS, planned(repo, *[WORDS] * len(EDITS), edits=[*EDITS]))) == EDITS


# What is done to a copy of results in a clone elsewhere, without .snakemake; a setting -> what is made again.
MADE_AGAIN = {"bake": 1, **AFTER_BAKING}
COPIES = {
    ("true", ""): {"report": 1, "viewer": 1},  # which show the name
    ("true", "train.lr=0.5"): {"train": 2, **AFTER_TRAINING},
    ("true", "figures.count=4"): {"figure": 1, "clean": 1, "align": 1, **MADE_AGAIN},
    ("rm maps/*/g0001.exr", ""): MADE_AGAIN,
    ("cp maps/*/g0001.exr maps/*/g0002.exr", ""): MADE_AGAIN,
    ("rm figures/*/g0001.npz", ""): {"figure": 1, "clean": 1, "align": 1, **MADE_AGAIN},
    ("rm train/*.csv", ""): {"train": 2, **AFTER_TRAINING},
    ("cp train/self_all.s0.safetensors train/ours_full.s0.safetensors", ""): {"train": 2, **AFTER_TRAINING},
    ("rm -r made/maps", "bake.rays=8"): {"report": 1, "viewer": 1},
}


def state(repo) -> dict[str, tuple[int, bytes]]:
    """Dates and contents of all files in results and in what Snakemake remembers of them."""
    files = [path for top in ("results", ".snakemake/metadata") for path in (repo / top).rglob("*") if path.is_file()]
    return {str(path): (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


def test_results_know_how_they_were_made(done, tmp_path):
    """Wherever they lie, and whatever Snakemake has forgotten; equal bytes train nothing again."""
    repo = tmp_path / "repo"
    shutil.copytree(done, repo, ignore=shutil.ignore_patterns("mlruns", ".snakemake"))
    words = []
    for number, (command, word) in enumerate(COPIES):
        results = shutil.copytree(repo / OUT, repo / "results" / f"copy{number}")
        assert output(results, ["sh", "-c", command]).returncode == 0
        words.append([*WORDS, f"name=copy{number}", *word.split()])
    before = state(repo)
    assert dict(zip(COPIES, planned(repo, *words))) == COPIES and state(repo) == before, "a dry run writes nothing"
    for number, path in enumerate(sorted((repo / OUT).rglob("*"), reverse=True)):  # as by `cp -r`, inputs after outputs
        os.utime(path, (time.time() - 1e4 + number,) * 2)
    before, hydra = state(repo), f"hydra={' '.join(WORDS)}"
    told = output(repo, [sys.executable, "-m", "snakemake", "all", "--summary", "--config", hydra]).stdout
    assert told.count("no update") > 20 and state(repo) == before, told
    kept = relight(repo, "run", *WORDS, "bake.rays=8", "--snakemake", "--rerun-triggers mtime")
    assert "(bake.rays): what depends on them" in kept.stdout and "Nothing to be done" in kept.stdout, kept.stdout
    assert hashes(repo) == hashes(done)
    maps = sorted((repo / OUT / "maps").rglob("*.exr"))
    dates = [path.stat().st_mtime_ns for path in maps]
    maps[1].unlink()
    run = relight(repo, "run", *WORDS)
    assert run.returncode == 0 and f"{maps[1].relative_to(repo)} is missing" in run.stdout, run.stdout
    assert [path.stat().st_mtime_ns == date for path, date in zip(maps, dates)] == [True, False, True]
    kept = re.findall(r"^(\w+) ?\S*: kept: it was made", run.stdout, re.M)
    assert kept.count("train") == 2 and kept.count("evaluate") == 3 and hashes(repo) == hashes(done)
    record, under_way = repo / OUT / "made/train/ours_full.s0.safetensors.json", repo / OUT / "train/state/ours_full.s0"
    record.write_text(json.dumps({**json.loads(record.read_text()), "unfinished": False}))  # as after a kill
    under_way.mkdir(parents=True)
    maps[1].unlink()
    run = relight(repo, "run", *WORDS, "--target", str(maps[1].parent.relative_to(repo)))
    assert run.returncode == 0 and maps[1].exists() and under_way.exists(), "a training goes on later"


MODULE = """
module relight:
    snakefile: "{}/workflow/Snakefile"
    config: {{"hydra": {}}}

use rule * from relight as relight_*

rule mine:
    input: rules.relight_all.input
"""


def test_another_workflow_takes_it_as_a_module(done, tmp_path):
    (tmp_path / "Snakefile").write_text(MODULE.format(done, [*WORDS]))
    command = [sys.executable, "-m", "snakemake", "--snakefile", tmp_path / "Snakefile", "--cores", "1"]
    run = output(done, [*command, "mine", "-n"])
    assert run.returncode == 0 and "Nothing to be done" in run.stdout, run.stdout
    shutil.copytree(done / OUT / "lights", tmp_path / OUT / "lights")
    shutil.copytree(done / OUT / "made" / "lights", tmp_path / OUT / "made" / "lights")
    (tmp_path / OUT / "lights" / "lights.csv").unlink()
    run = output(tmp_path, [*command, "--until", "relight_lights"])
    assert run.returncode == 0, run.stdout
    assert json.loads((tmp_path / OUT / "made/lights/lights.csv.json").read_text())["rule"] == "lights"
    again, table = ((folder / OUT / "lights" / "lights.csv").read_bytes() for folder in (tmp_path, done))
    assert again == table


@pytest.mark.parametrize(("words", "told"), [
    ("all --cache bake", "--cache knows no code of relight"),
    ("all --config scale=smoke --config name=x", "Snakemake drops one of two --config"),
    ("evaluate --config scale=smoke", "evaluate has several jobs: snakemake --until evaluate"),
])  # fmt: skip
def test_what_snakemake_would_take_otherwise_is_refused(done, words, told):
    run = output(done, [sys.executable, "-m", "snakemake", "-n", *words.split()])
    assert run.returncode == 1 and told in run.stdout and "Traceback" not in run.stdout


def test_a_second_workflow_at_the_same_time_is_refused(done, tmp_path):
    """Where both have begun before either makes anything."""
    handle = hold(tmp_path / OUT)
    words = ["--snakefile", done / "Snakefile", f"{OUT}/lights/lights.npz", "--cores", "1", "--config", "scale=smoke"]
    run = output(tmp_path, [sys.executable, "-m", "snakemake", *words, "--nolock"])  # of Snakemake's own lock alone
    assert run.returncode == 1 and f"another workflow is making {OUT}: wait for it" in run.stdout, run.stdout
    assert "Traceback" not in run.stdout
    os.close(handle)


def test_records_that_cannot_be_written_are_a_sentence(tmp_path):
    """Here for a name that is too long; as in a folder that is read-only."""
    repo, name = copy(tmp_path), "x" * 250
    (repo / OUT / "made").mkdir(parents=True)
    (repo / OUT / name).touch()
    record = {"rule": "split", "params": {}, "inputs": {}, "files": {"": [0, hashlib.sha256().hexdigest()[:16]]}}
    (repo / OUT / "made" / f"{name}.json").write_text(json.dumps({**record, "code": {}}))
    run = output(repo, [sys.executable, "-m", "snakemake", "--cores", "1", "--config", "scale=smoke"])
    assert run.returncode == 1 and "cannot be written: file name too long" in run.stdout, run.stdout
    assert "UserError" not in run.stdout and "Traceback" not in run.stdout


def test_errors_are_one_line(done):
    run = relight(done, "run", "scale=smoke", "figures=scans", "figures.folder=/nowhere/at/all")
    lines = run.stdout.strip().splitlines()
    assert run.returncode == 1 and len(lines) == 1 and "no folder /nowhere/at/all" in lines[0], run.stdout
    words = f"{sys.executable} -m relight.cli run scale=smoke figures=scans figures.folder=nowhere"
    run = output(done, ["sh", "-c", f"cd conf && {words}"])
    assert f"no folder {done}/nowhere" in run.stdout, run.stdout
