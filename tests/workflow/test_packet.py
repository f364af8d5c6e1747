"""The packet of a run: an RO-Crate, from which the run is repeated."""

import io
import json
import shutil
import subprocess
import sys
import tarfile
import zipfile

import pytest
from repo import OUT, output

pytestmark = pytest.mark.slow
pytest.importorskip("rocrate")


def packed(repo):
    return output(repo, [sys.executable, "tools/packet.py", "smoke"])


def test_a_packet_lists_each_job_with_its_times_and_has_all_that_it_names(done, tmp_path):
    repo = tmp_path / "repo"
    shutil.copytree(done, repo, ignore=shutil.ignore_patterns("mlruns", ".snakemake"))
    commit = "-c user.name=a -c user.email=a@example.org commit -qm all"
    for words in ("init -q", "add --all", commit):
        subprocess.run(["git", *words.split()], cwd=repo, check=True)
    (repo / "Makefile").write_text("all:\n")
    run = packed(repo)
    assert run.stdout == "build/smoke.crate.zip\n", run.stdout
    with zipfile.ZipFile(repo / "build" / "smoke.crate.zip") as crate:
        graph = json.loads(crate.read("ro-crate-metadata.json"))["@graph"]
        names = set(crate.namelist())
        with tarfile.open(fileobj=io.BytesIO(crate.read("source.tar.gz"))) as source:
            assert source.extractfile("Makefile").read() == b"all:\n", "what is on the disk, not what is committed"
        assert b"+all:" in crate.read("source.diff") and b"name=smoke" in crate.read("README.md")
        network = crate.read("train/ours_full.s0.safetensors")
    assert network == (repo / OUT / "train" / "ours_full.s0.safetensors").read_bytes()
    entities = {entity["@id"]: entity for entity in graph}
    files = {name for name, entity in entities.items() if "File" in entity["@type"]}
    assert files <= names and {"run.yaml", "report/report.html", "made/maps/g0000-g0009.json"} <= files
    jobs = [entity for entity in graph if entity["@type"] == "CreateAction" and entity["@id"] != "#run"]
    rules = {job["instrument"]["@id"] for job in jobs}
    assert rules >= {f"workflow/scripts/{rule}.py" for rule in ("figure", "bake", "pack", "lights", "train", "report")}
    assert sum("train.py" in job["instrument"]["@id"] for job in jobs) == 2
    for job in jobs:
        assert job["startTime"] <= job["endTime"] and len(job["resourceUsage"]) == 2
        assert float(entities[job["resourceUsage"][0]["@id"]]["value"]) > 0
    baked = entities["#bake-maps/g0000-g0009"]
    assert baked["object"] == {"@id": "#aligned/g0000-g0009"} and baked["result"] == {"@id": "#maps/g0000-g0009"}
    record = (repo / OUT / "run.yaml").read_text()
    (repo / OUT / "run.yaml").write_text(record.replace("lr: 0.002", "lr: 0.003"))
    run = packed(repo)
    assert run.returncode == 1 and "made with other settings than its last command's (train.lr)" in run.stdout
    (repo / OUT / "run.yaml").write_text(record)
    (repo / OUT / "split.json").write_text("{}")
    run = packed(repo)
    assert run.returncode == 1 and "split.json is another one" in run.stdout and "run it again first" in run.stdout
    (repo / OUT / "made" / "report" / "report.html.json").unlink()
    shutil.copy(done / OUT / "split.json", repo / OUT / "split.json")
    run = packed(repo)
    assert run.returncode == 1 and "results/smoke has no report: finish the run first" in run.stdout
