"""Records of how results were made: what a job keeps by them, and what Snakemake learns from them."""

import os
import shutil
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import snakemake.api

from relight.extensions import READ, reads
from relight.lab import made
from relight.lab.made import CHANGED, begin, describe, finish, is_made, outdated, read, restore

FIGURES, MAPS, PACKED = "results/a/figures/g0000-g0009", "results/a/maps/g0000-g0009", "results/a/packed.safetensors"
NAMES = ["g0000", "g0001"]
CLOCK = count(10**18, 10**9)  # dates of files, nanoseconds


@pytest.fixture(autouse=True)
def code(tmp_path, monkeypatch) -> dict[str, str]:
    """An empty folder, and the hash of the code of each rule."""
    monkeypatch.chdir(tmp_path)
    READ.clear()
    hashes = {"figure": "c", "bake": "c", "pack": "c", "scan": "c"}
    monkeypatch.setattr(made, "code_of", lambda rule: {rule: hashes[rule]})
    monkeypatch.setattr(made, "code_hash", hashes.get)
    return hashes


def write(path: str, text: str) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text)
    os.utime(path, ns=(next(CLOCK),) * 2)


def figure(names: list[str], text: str = "1", cloth: str = "c") -> list[str] | None:
    """Draws figures, as the rule does, and returns those that it drew; None if it kept all."""
    record = describe("figure", {"names": names, "cloth": cloth}, [], FIGURES)
    return work(FIGURES, record, {name: f"{name}.npz" for name in names}, text)


def bake(text: str = "1", rays: int = 8) -> list[str] | None:
    record = describe("bake", {"rays": rays}, [FIGURES], MAPS)
    files = {path.stem: f"{path.stem}.exr {path.stem}.v1.exr" for path in sorted(Path(FIGURES).glob("*.npz"))}
    return work(MAPS, record, files, text)


def work(output: str, record: dict, files: dict[str, str], text: str) -> list[str] | None:
    try:
        stay = begin([output], record)
    except SystemExit as end:
        assert end.code is None
        return None
    made = [name for name in files if name not in stay]
    for name in made:
        for file in files[name].split():
            write(f"{output}/{file}", name + text)
    finish([output], record)
    return made


def test_a_job_makes_the_figures_that_are_new_or_changed():
    assert figure(NAMES) == NAMES and bake() == NAMES
    assert figure(NAMES) is None and bake() is None
    assert figure([*NAMES, "g0002"]) == ["g0002"] and bake() == ["g0002"]
    assert figure(NAMES[1:]) == [] and os.listdir(FIGURES) == ["g0001.npz"]
    assert bake() == [] and sorted(os.listdir(MAPS)) == ["g0001.exr", "g0001.v1.exr"]
    assert figure(NAMES, "2") == ["g0000"] and bake() == ["g0000"]
    assert figure(NAMES, "3", cloth="d") == NAMES and bake() == NAMES
    assert figure(NAMES, "3", cloth="e") == NAMES and bake() is None, "the same bytes"
    assert bake(rays=9) == NAMES
    write(f"{MAPS}/g0001.v1.exr", "????????")
    write(f"{MAPS}/g0007.exr", "of nobody")
    assert bake(rays=9) == ["g0001"] and "g0007.exr" not in os.listdir(MAPS)
    write(f"{FIGURES}/g0000.npz", "edited")
    assert bake(rays=9) == ["g0000"]
    restore("results/a"), began()
    write(f"{MAPS}/g0001.exr", "0001g1")  # of the same size, and older than its record
    os.utime(f"{MAPS}/g0001.exr", (1e9, 1e9))
    assert bake(rays=9) == ["g0001"]


def test_a_job_makes_all_again_if_code_has_changed_that_made_any_of_it(code, monkeypatch):
    assert figure(NAMES) == NAMES
    code["figure"] = "d"
    assert figure(NAMES) == NAMES and figure(NAMES) is None
    monkeypatch.setattr(made, "code_of", lambda rule: {f"more than {rule}": code.setdefault(f"more than {rule}", "c")})
    assert figure([*NAMES, "g0002"]) == ["g0002"] and read(FIGURES)["code"] == {"figure": "d", "more than figure": "c"}
    code["figure"] = "e"
    assert known() == {FIGURES: [f"{CHANGED}figure has changed'"]}
    assert figure(NAMES) == NAMES and read(FIGURES)["code"] == {"more than figure": "c"}


def test_changes_of_what_is_gone_are_known(code):
    """As of a temporary folder: what was made of it is made again for them."""
    figure(NAMES), bake()
    shutil.rmtree(FIGURES)
    code["figure"] = "d"
    assert known() == {MAPS: []} and f"{CHANGED}figure has changed'" in metadata(FIGURES)["params"]


def test_a_file_is_made_again_for_other_inputs_params_code_or_content(tmp_path):
    figure(NAMES)
    (scan := tmp_path / "a scan.obj").write_text("1")

    def pack(**params: object) -> bool:
        return work(PACKED, describe("pack", params, [FIGURES, str(scan)], PACKED), {}, "") is not None

    write(PACKED, "1")
    assert pack(size=1, scale=0.1) and not pack(size=1, scale=0.1) and pack(size=2, scale=0.1)
    write(PACKED, "2")
    assert pack(size=2, scale=0.1) and not pack(size=2, scale=0.1)
    scan.write_text("2")
    assert pack(size=2, scale=0.1) and not pack(size=2, scale=0.1)
    figure(NAMES, "2", cloth="d")
    assert pack(size=2, scale=0.1) and not pack(size=2, scale=0.1)
    os.utime(scan, (1e9, 1e9))
    assert outdated(PACKED, read(PACKED)) is None and not pack(size=2, scale=0.1)
    scan.write_text("3")
    os.utime(scan, (1e9, 1e9 + 1))  # older than what was made of it, as after unzip
    assert outdated(PACKED, read(PACKED)) == f"{PACKED} was made of another {scan}"
    assert pack(size=2, scale=0.1) and not pack(size=2, scale=0.1)
    scan.write_text("4")
    os.utime(scan, (1e9, 1e9 + 1))  # of the same size and date, as by `touch -r`, or swapped with another
    assert outdated(PACKED, read(PACKED)) == f"{PACKED} was made of another {scan}"
    Path(PACKED).unlink()
    assert pack(size=2, scale=0.1)


def test_a_file_is_made_again_for_what_its_job_found_by_itself(tmp_path):
    """Below the working directory, which may move, and elsewhere; also when it appears where the job looked first."""
    outside = tmp_path.parent / f"{tmp_path.name}.png"
    sought = [reads("scans/skin.png"), reads(outside), reads(Path("scans", "skin.mtl").resolve())]
    write("scans/skin.png", "1"), write(str(outside), "1"), write("scans/a.obj", "1")

    def scan() -> bool:
        return work(PACKED, describe("scan", {}, ["scans/a.obj"], PACKED), {}, "") is not None

    write(PACKED, "1")
    assert scan() and not scan()
    assert {*read(PACKED)["found"]} == {"../../scans/skin.png", "../../scans/skin.mtl", str(outside)}
    for path in map(str, sought):
        write(path, "2")
        assert "was made of another" in outdated(PACKED, read(PACKED)) and scan() and not scan()
    os.utime(outside, (1e9, 1e9))
    assert outdated(PACKED, read(PACKED)) is None and not scan()
    outside.unlink()
    assert "was made of another" in outdated(PACKED, read(PACKED)) and scan() and not scan()
    write("results/scans/a.obj", "1"), write("results/scans/skin.png", "1"), reads("results/scans/skin.png")
    assert work(MAPS, describe("scan", {}, ["results/scans/a.obj"], MAPS), {}, "") == []
    assert outdated(MAPS, read(MAPS)) is None
    write("results/scans/skin.png", "2")
    assert "was made of another" in outdated(MAPS, read(MAPS)), "below results, where scans have no records"
    shutil.rmtree("scans")
    assert outdated(PACKED, read(PACKED)) is None, "results were copied without the scans"


def test_a_job_that_failed_leaves_what_it_would_have_replaced_as_unfinished():
    figure(NAMES)
    before = read(FIGURES)
    begin([FIGURES], describe("figure", {"names": NAMES, "cloth": "d"}, [], FIGURES))
    assert len(os.listdir(FIGURES)) == len(NAMES) and not is_made(FIGURES), "nothing goes before its successor is there"
    assert outdated(FIGURES, read(FIGURES)) is None and not is_made(FIGURES)
    assert known() == {FIGURES: [f"{CHANGED}{FIGURES} is unfinished'"]}
    assert figure(NAMES) is None and is_made(FIGURES) and read(FIGURES) | {"dates": before["dates"]} == before


def test_what_a_first_job_has_begun_is_unfinished():
    """In a copy of a run that still runs, too."""
    for _ in range(2):  # of a job that was killed before it made anything
        begin([FIGURES], describe("figure", {"names": NAMES, "cloth": "c"}, [], FIGURES))
    write(f"{FIGURES}/g0000.npz", "g00001")
    assert known() == {FIGURES: [f"{CHANGED}{FIGURES} is unfinished'"]}
    assert figure(NAMES) == NAMES and is_made(FIGURES)


def began(dryrun: bool = False, **options) -> Any:
    """Has Snakemake begin to make results, or say what it would make; returns what it knows."""
    workflow = SimpleNamespace(executor_plugin=True, dryrun=dryrun, iocache=snakemake.io.IOCache(None))
    workflow.dag_settings = SimpleNamespace(max_checksum_file_size=0)
    return snakemake.workflow.FilePersistence(dag=SimpleNamespace(workflow=workflow), **options)


def metadata(output: str) -> dict:
    return dict(began(dryrun=True)._read_record(output).items())


def known() -> dict[str, list[str]]:
    """What Snakemake knows to have changed, by output."""
    restore("results/a")
    outputs = [output for output in (FIGURES, MAPS) if Path(output).exists()]
    return {output: [param for param in metadata(output)["params"] if param.startswith(CHANGED)] for output in outputs}


def test_snakemake_learns_what_it_does_not_know():
    """Params as it writes them, and one more if files do not fit the record."""
    figure(NAMES), bake()
    assert known() == {FIGURES: [], MAPS: []}
    assert metadata(FIGURES)["params"] == ["'c'", "['g0000', 'g0001']"] and metadata(MAPS)["input"] == [FIGURES]
    assert snakemake.workflow.DbPersistence is snakemake.workflow.FilePersistence
    for store in began(dryrun=True, db_url="sqlite://"), began(dryrun=True):
        assert store._read_record(MAPS).input == [FIGURES], "as with --persistence-backend db"
    touched = store._read_record(MAPS)
    touched.params = ["'touched'"]
    store._write_record(MAPS, touched)
    assert known() == {FIGURES: [], MAPS: []} and metadata(MAPS)["params"] == ["8"], "as by `snakemake --touch`"
    write(f"{MAPS}/.snakemake_timestamp", "")
    assert known() == {FIGURES: [], MAPS: []} and metadata(MAPS)["params"] == ["8"], "they were replaced by others"
    file = Path(MAPS, "g0000.exr").rename("kept")
    assert known() == {FIGURES: [], MAPS: [f"{CHANGED}{MAPS}/g0000.exr is missing'"]}
    shutil.copy(file, f"{MAPS}/g0000.exr")
    assert known() == {FIGURES: [], MAPS: []}
    write(f"{MAPS}/g0000.exr", "another")
    assert known() == {FIGURES: [], MAPS: [f"{CHANGED}{MAPS}/g0000.exr is another one'"]}
    bake()
    figure(NAMES, "2", cloth="d")
    assert known() == {FIGURES: [], MAPS: [f"{CHANGED}{MAPS} was made of another figures/g0000-g0009'"]}
    write(PACKED, "1"), write("results/a/made/packed.safetensors.json", "{")
    shutil.rmtree(FIGURES)
    assert known()[MAPS] and bake(rays=8) == []


@pytest.mark.parametrize("text", ["[1]", "3", "null", '{"rule": "pack"}', "{",
                                  '{"code": "old", "params": {}, "inputs": {}, "files": {}}'])  # fmt: skip
def test_a_record_of_another_shape_is_none(text):
    write(PACKED, "1"), write("results/a/made/packed.safetensors.json", text)
    assert restore("results/a") == {} and read(PACKED) == {}
    assert work(PACKED, describe("pack", {}, [], PACKED), {}, "") == []


def test_files_get_a_date_when_results_are_locked():
    """Not in a dry run, and not if another process has made them since they were looked at."""
    figure(NAMES)
    file, calls = Path(FIGURES, "g0000.npz"), []
    os.utime(file, (1e9, 1e9))
    before = read(FIGURES)
    restore("results/a", lambda: calls.append(read(FIGURES)))
    planned = began(dryrun=True).dag.workflow.iocache.mtime[FIGURES].local()
    assert not calls and file.stat().st_mtime == 1e9 < planned
    began()
    assert calls == [before] and file.stat().st_mtime == pytest.approx(planned, abs=1e-3) and read(FIGURES) != before
    os.utime(file, (1e9, 1e9))
    restore("results/a", lambda: figure(NAMES, "2", cloth="d"))
    began()
    assert read(FIGURES)["params"]["cloth"] == "d"
