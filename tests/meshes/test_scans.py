"""Folders of scans as the sources deliver them."""

import os
import re
import shlex
import tempfile
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given, settings
from hypothesis import strategies as st
from snakemake.io import apply_wildcards

from relight.core.errors import UserError
from relight.core.files import atomic_write, is_unsafe_name
from relight.meshes import Mesh, list_scans
from relight.meshes.scans import one_subject, read_scan


def touch(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")


def listed(folder):
    return {name: (scan.path.relative_to(folder).as_posix(), scan.subject) for name, scan in list_scans(folder).items()}


def test_the_layouts_of_renderpeople_thuman_buff_and_own_folders(tmp_path):
    touch(tmp_path / "flat", "b.ply", "a.OBJ", "a.mtl", "skin.png", "c d.glb", "notes.txt", ".trash/e.ply")
    assert listed(tmp_path / "flat") == {"a": ("a.OBJ", "a"), "b": ("b.ply", "b"), "c_d": ("c d.glb", "c_d")}
    tmp_path /= "scans"
    for name in ("013_OBJ/rp_aaron_posed_013_30k.obj", "013_OBJ/rp_aaron_posed_013_100k.obj",
                 "013_OBJ/tex/rp_aaron_posed_013_dif_8k.jpg", "014_OBJ/rp_aaron_posed_014.obj"):  # fmt: skip
        touch(tmp_path, f"rp_aaron_posed_{name}")
    touch(tmp_path, "people/rp_bob_posed_001_OBJ/rp_bob_posed_001.obj", "0001/0001.obj", "0001/material0.jpeg")
    touch(tmp_path, "eve/standing.glb", "Eve/sitting_LOD0.glb", "Eve/sitting_lod1.glb", "eve/waving_lod.glb")
    touch(tmp_path, "adam/standing.glb", "adam/standing_30k.glb", "adam/standing_LOD2.glb")
    assert listed(tmp_path) == {
        "0001": ("0001/0001.obj", "0001"),
        "adam_standing": ("adam/standing.glb", "adam"),
        "eve_standing": ("eve/standing.glb", "Eve"),
        "rp_bob_posed_001": ("people/rp_bob_posed_001_OBJ/rp_bob_posed_001.obj", "bob"),
        "rp_aaron_posed_013_100k": ("rp_aaron_posed_013_OBJ/rp_aaron_posed_013_100k.obj", "aaron"),
        "rp_aaron_posed_014": ("rp_aaron_posed_014_OBJ/rp_aaron_posed_014.obj", "aaron"),
        "sitting_LOD0": ("Eve/sitting_LOD0.glb", "Eve"),
        "waving_lod": ("eve/waving_lod.glb", "Eve"),
    }
    touch(tmp_path / "flat", "rp_eve_posed_001.obj", "rp_eve_posed_002.obj")
    assert [scan.subject for scan in list_scans(tmp_path / "flat").values()] == ["eve", "eve"]
    for person in ("00005", "00096"):
        touch(tmp_path / "buff/sequences" / person, "walk/walk.000001.ply", "walk/walk.000002.ply")
    for folder in ("buff", "buff/sequences"):  # the folder itself, and the one above it
        found = list_scans(tmp_path / folder).values()
        assert sorted(scan.subject for scan in found) == ["00005", "00005", "00096", "00096"]
        assert all(scan.subject == scan.path.parts[-3] for scan in found)
    touch(tmp_path / "one/sequences", "walk.000001.ply", "walk.000002.ply")  # of one person, as in other subfolders
    assert {scan.subject for scan in list_scans(tmp_path / "one").values()} == {"sequences"}


@pytest.mark.parametrize(("files", "people"), [
    (("model/0000/0000.obj", "model/0001/0001.obj", "smplx/0001/mesh_smplx.obj"), {"0000", "0001"}),  # THuman 2.1
    (("mesh/eve.obj", "smplx/eve_smplx.obj", "scans/adam.ply", "SMPL-X/adam.obj"), {"eve", "adam"}),
    (("train/meshes/eve/a.obj", "test/scans/eve/b.obj", "eve/mesh/c.obj", "eve/smpl/c.obj"), {"eve"}),
    (("eve/0000/0000.obj", "eve/0001/0001.obj"), {"eve"}),  # not told from two people: the run says so
    (("mesh/mesh.obj",), {"mesh"}),
])  # fmt: skip
def test_a_folder_of_a_kind_of_files_is_nobody(tmp_path, files, people):
    touch(tmp_path, *files)
    scans = list_scans(tmp_path)
    assert {scan.subject for scan in scans.values()} == people and len(scans) == len(files)
    assert bool(one_subject(scans)) == (len(people) == 1 < len(files))
    (tmp_path / "scans.csv").write_text("\n".join(["name,path", *(f"s{i},{file}" for i, file in enumerate(files))]))
    assert {scan.subject for scan in list_scans(tmp_path).values()} == people


def test_a_table_replaces_the_listing(tmp_path):
    touch(tmp_path, "x/a.ply", "x/b.ply", "c.ply", "d.ply")
    (tmp_path / "scans.csv").write_text("use,name,subject,path\n1,second,eve,x\\b.ply\n0,first,eve,x/a.ply\n,,,c.ply\n")
    assert listed(tmp_path) == {"second": ("x/b.ply", "eve"), "c": ("c.ply", "c")}
    (tmp_path / "scans.csv").write_text("name,path\nfirst,x/a.ply\nsecond,x\\b.ply\n,./d.ply\n")
    assert {name: subject for name, (_, subject) in listed(tmp_path).items()} == {"first": "x", "second": "x", "d": "d"}
    outside = f"../{tmp_path.name}/c.ply", f"{tmp_path}/x/a.ply"  # folders outside say nothing about the person
    (tmp_path / "scans.csv").write_text("path\n" + "\n".join(outside))
    assert [scan.subject for scan in list_scans(tmp_path).values()] == ["c", "a"]
    for text, says in (("path,name\nc.ply,a\nd.ply,A\n", "names A twice"), ("use,path\n0,c.ply\n", "chooses no scan")):
        (tmp_path / "scans.csv").write_text(text)
        with pytest.raises(UserError, match=says):
            list_scans(tmp_path)


def test_linked_folders_are_read_once(tmp_path):
    touch(tmp_path, "elsewhere/eve/a.ply", "scans/b.ply")
    for name in ("all", "again"):
        (tmp_path / "scans" / name).symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere" / "eve" / "up").symlink_to(tmp_path / "scans")
    assert listed(tmp_path / "scans") == {"a": ("again/eve/a.ply", "again"), "b": ("b.ply", "b")}


@pytest.mark.parametrize(("files", "says"), [
    ((), r"no folder.*\.ply, \.obj, \.glb, \.gltf and \.stl"),
    (("a.fbx", "skin.png"), r"holds no scans; \.ply"),
    (("eve.obj", "eve.ply"), r"eve\.obj and .*eve\.ply have one name.*keep one"),
])  # fmt: skip
def test_folders_without_meshes_or_with_two_of_one_name_are_refused(tmp_path, files, says):
    touch(tmp_path / "scans", *files)
    with pytest.raises(UserError, match=says):
        list_scans(tmp_path / "scans")


def test_parent_folders_do_not_matter(tmp_path, monkeypatch):
    touch(tmp_path / ".data" / "scans", "a.ply", ".hidden/b.ply", "c/.d.ply")
    assert list(list_scans(tmp_path / ".data" / "scans")) == ["a"]
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert list(list_scans("../.data/scans")) == ["a"]


def test_names_are_ascii_and_distinct(tmp_path):
    touch(tmp_path, "Zoë.obj", "null.obj", "1e5.obj", "a b.ply", "a_b.ply", "Eve.ply", "eve.glb", "人.obj", "火.obj")
    names = list_scans(tmp_path)
    assert {"Zoe", "null", "1e5"} < set(names)
    for start, count in (("a_b_", 2), ("Eve_", 1), ("eve_", 1), ("scan_", 2)):
        assert sum(re.fullmatch(start + "[0-9a-f]{8}", name) is not None for name in names) == count
    before = {scan.path.name: name for name, scan in names.items()}
    touch(tmp_path, "other.ply")
    assert {scan.path.name: name for name, scan in list_scans(tmp_path).items()}.items() > before.items()


# Everything that Linux lets into a file's name: any bytes but / and 0, up to 255 with the suffix.
LEGAL = st.one_of(
    st.text(st.characters(blacklist_characters="/\0", blacklist_categories=("Cs",)), min_size=1, max_size=60),
    st.text("aA1_-.'\"${}()`;&|\\ \n\t*?[]~#%=,:", min_size=1, max_size=251),
    st.binary(min_size=1, max_size=251).map(lambda b: os.fsdecode(b.replace(b"/", b"a").replace(b"\0", b"b"))),
    st.sampled_from(["null", "true", "1e5", "1_000", "a{output}", "-rf", "Zoe\u0308", "Zoë", "A" * 251, "a" * 251]),
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(LEGAL, min_size=1, max_size=5))
@pytest.mark.slow
def test_any_legal_file_name_gives_a_name_that_passes_through_the_workflow(stems):
    with tempfile.TemporaryDirectory() as folder:
        files = set()
        for stem in stems:
            path = Path(folder) / f"{os.fsdecode(os.fsencode(stem)[:250])}.ply"
            if not path.name.startswith("."):
                path.write_bytes(b"x")
                files.add(path)
        if not files:
            return
        scans = list_scans(folder)
        finest = {path for path in files if not re.search(r"_\d+k$", path.stem, re.IGNORECASE)}
        assert finest <= {scan.path for scan in scans.values()} <= files
        assert len({name.lower() for name in scans}) == len(scans)
        for name, scan in scans.items():
            assert all(re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,99}", word) for word in (name, scan.subject))
            word = shlex.split(f'io.figure="\'"{shlex.quote(name)}"\'" ')[0]  # as the rules quote it
            (override,) = OverridesParser.create().parse_overrides([word])
            assert override.value() == name and isinstance(override.value(), str)
            if not is_unsafe_name(scan.path):
                assert apply_wildcards(str(scan.path), {"figure": name}) == str(scan.path)
            with atomic_write(Path(folder) / "out" / f"{name}.safetensors") as temporary:
                temporary.write_bytes(b"x")


def test_a_file_that_the_workflow_cannot_name_is_left_out_with_a_line(tmp_path, capsys, monkeypatch):
    odd_ones = ("a{output}.ply", "b\nc.ply", os.fsdecode(b"\xff.ply"))
    touch(tmp_path, *odd_ones)
    for name, scan in list_scans(tmp_path).items():
        read_scan(scan.path, name, scan.subject, tmp_path / "out.npz")
        reason = Mesh.load(tmp_path / "out.npz").info["left_out"]
        assert "rename it" in reason and reason.isascii() and reason.isprintable()
        assert f"{name} is left out: {reason}\n" == capsys.readouterr().err and scan.path.name in odd_ones
