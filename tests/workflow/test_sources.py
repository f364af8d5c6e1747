"""The user's own meshes and panoramas as the source, and a mesh that cannot be used."""

import json
import os
import shutil

import pytest
from people import write_people
from PIL import Image
from repo import copy, planned, relight
from samples import write_exr

from relight.maps import read_info
from relight.panoramas import generate_room

WORDS = ("scale=smoke", "name=mine", "experiment=one", "split.test=0.34", "train.steps=6")


@pytest.mark.slow
def test_three_meshes_and_two_panoramas_give_a_data_set(tmp_path):
    scans, panoramas, repo = tmp_path / "scans", tmp_path / "panoramas", copy(tmp_path)
    write_people(scans)
    (scans / "broken.ply").write_bytes((scans / "colored.ply").read_bytes()[:500])
    panoramas.mkdir()
    for seed in (1, 2):
        write_exr(panoramas / f"room{seed}.exr", generate_room(seed))
    (table := repo / "axes.csv").write_text("name,turn\nplain,0\n")
    (scans / "plain.mtl").touch()  # which no mesh names
    words = [*WORDS, "figures=scans", f"figures.folder={scans}", "panoramas=folder", f"panoramas.folder={panoramas}"]
    words += ["bake.views=1", f"align.table={table}"]
    targets = "--target=results/mine/packed.safetensors", "--target=results/mine/lights/lights.npz"
    run = relight(repo, "run", *words, *targets)
    assert run.returncode == 0, run.stdout
    record = json.loads((repo / "results/mine/figures.json").read_text())
    assert set(record["figures"]) == {"broken", "colored", "plain", "textured"}
    assert set(record["left_out"]) == {"broken"} and "broken is left out" in run.stdout
    assert read_info(repo / "results/mine/maps/plain/plain.v1.exr")["figure"] == "plain"
    (jobs,) = planned(shutil.copytree(repo, tmp_path / "moved"), words)
    assert not {"scan", "align", "bake", "lights"} & jobs.keys()
    shutil.copy(scans / "colored.ply", scans / "another.ply")
    table.write_text("name,turn\nplain,9\n")
    os.utime(table, (1e9, 1e9))  # as after `cp -p` or unzip
    edits = [None, *((str(scans / name), "#\n") for name in ("plain.mtl", "material.mtl"))]
    jobs, *edited = planned(repo, words, words, words, edits=edits)
    assert (jobs["scan"], jobs["align"], jobs["bake"], jobs["pack"]) == (1, 5, 5, 1) and "lights" not in jobs
    assert [jobs["scan"] for jobs in edited] == [1, 2]
    for name in ("plain.glb", "material.mtl"):  # other dates alone scan nothing
        os.utime(scans / name, (1e9, 1e9))
    Image.new("RGB", (64, 64), "red").save(picture := scans / "material_0.png")
    for path in (picture, write_exr(panoramas / "room1.exr", generate_room(3))):
        os.utime(path, (1e9, 1e9))
    (jobs,) = planned(repo, words)
    assert (jobs["scan"], jobs["lights"]) == (2, 1)
