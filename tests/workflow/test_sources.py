"""The user's own meshes and panoramas as the source, and meshes that cannot be used."""

import json
import shutil

import numpy as np
import pytest
from people import write_people
from repo import copy, planned, relight

from relight.maps import read_info
from relight.panoramas import generate_room

WORDS = ("scale=smoke", "name=mine", "experiment=one", "split.test=0.34", "train.steps=6")


def write_hdr(path, pixels) -> None:
    """A Radiance picture, flat RGBE (G. Ward's format), of (H, W, 3) floats."""
    mantissa, exponent = np.frexp(pixels.max(-1))
    scale = np.where(pixels.max(-1) > 1e-32, mantissa * 256 / np.maximum(pixels.max(-1), 1e-32), 0)
    rgbe = np.concatenate([pixels * scale[..., None], (exponent + 128)[..., None]], -1).astype(np.uint8)
    height, width = pixels.shape[:2]
    path.write_bytes(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + rgbe.tobytes())


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sources")
    write_people(folder / "scans")
    (folder / "scans" / "broken.ply").write_bytes((folder / "scans" / "colored.ply").read_bytes()[:500])
    (folder / "panoramas").mkdir()
    for seed in (1, 2):
        write_hdr(folder / "panoramas" / f"room{seed}.hdr", generate_room(seed))
    return folder


@pytest.mark.slow
def test_three_meshes_and_two_panoramas_give_a_report(sources, tmp_path):
    repo = copy(tmp_path)
    table = repo / "axes.csv"
    table.write_text("name,turn\nplain,0\n")
    words = [
        *WORDS,
        "figures=scans",
        f"figures.folder={sources / 'scans'}",
        "panoramas=folder",
        f"panoramas.folder={sources / 'panoramas'}",
        "bake.views=1",
        f"align.table={table}",
    ]
    run = relight(repo, "run", *words)
    assert run.returncode == 0, run.stdout
    record = json.loads((repo / "results/mine/figures.json").read_text())
    assert set(record["figures"]) == {"broken", "colored", "plain", "textured"}
    assert set(record["left_out"]) == {"broken"} and "broken is left out" in run.stdout
    assert read_info(repo / "results/mine/maps/plain/plain.v1.exr")["figure"] == "plain"
    page = (repo / "results/mine/report/report.html").read_text()
    assert "broken.ply" in page and page.count("data:image/") >= 5
    assert (repo / "results/mine/report/one.csv").stat().st_size > 100

    table.write_text("name,turn\nplain,9\n")
    (jobs,) = planned(repo, words)
    assert jobs["align"] == 4 and "lights" not in jobs
    shutil.copy(sources / "scans" / "colored.ply", sources / "scans" / "another.ply")
    (jobs,) = planned(repo, [word for word in words if "table" not in word])
    assert (jobs["scan"], jobs["bake"], jobs["pack"]) == (1, 5, 1)


@pytest.mark.slow
def test_too_few_usable_meshes_end_the_run(sources, tmp_path):
    folder = tmp_path / "scans"
    folder.mkdir()
    for name in ("broken", "colored"):
        shutil.copy(sources / "scans" / f"{name}.ply", folder)
    repo = copy(tmp_path)
    run = relight(
        repo, "run", *WORDS, "figures=scans", f"figures.folder={folder}", "--target", "results/mine/split.json"
    )
    assert run.returncode == 1 and "only 1 of 2 figures are usable" in run.stdout and "Traceback" not in run.stdout
    assert not (repo / "results/mine/packed.safetensors").exists()
