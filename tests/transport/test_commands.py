"""`relight bake` as a person runs it."""

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner

from relight.core.errors import UserError
from relight.maps import read_maps
from relight.transport.commands import app


@pytest.fixture
def mesh(tmp_path, monkeypatch):
    """A standing capsule with a nose, z up and facing -y, in millimetres."""
    body = trimesh.creation.capsule(radius=200, height=1200, count=[24, 24])
    nose = trimesh.creation.icosphere(subdivisions=2, radius=80)
    nose.apply_translation([0, -190, 1150])
    monkeypatch.chdir(tmp_path)
    trimesh.util.concatenate([body, nose]).export("thing.obj")
    return tmp_path / "thing.obj"


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)


def test_maps_and_vertices_are_where_asked_for_or_else_beside_the_user(mesh, tmp_path):
    outs = [tmp_path / f"out/a{suffix}" for suffix in (".exr", ".png", ".ply", ".npz")]
    options = ["--size", 64, "--rays", 32, "--order", 1, "--up", "+z", "--front=-y"]
    result = run(mesh, *options, *[word for out in outs for word in ("--out", out)])
    assert result.exit_code == 0 and result.stdout.split() == [str(out) for out in outs], result.output
    maps = read_maps(outs[0])
    assert maps.transport.shape == (64, 64, 4) and maps.info["name"] == "thing"
    rows = np.flatnonzero(maps.mask.any(1))
    assert (rows[0], rows[-1]) == (3, 60)  # 5 % of 64 pixels above and below
    nose = np.unravel_index(np.argmin(np.where(maps.mask, maps.depth, 9)), maps.mask.shape)
    assert 3 < nose[0] < 20 and abs(nose[1] - 32) < 3  # in front, near the top, in the middle
    assert Image.open(outs[1]).size[0] > 50 and np.load(outs[3])["transport"].shape[1] == 4
    assert len(trimesh.load(outs[2], process=False).vertices) == len(np.load(outs[3])["vertices"])
    assert run(mesh, "--size", 16, "--rays", 4).stdout.split() == ["thing.exr"] and (tmp_path / "thing.exr").exists()


def test_a_view(mesh, tmp_path):
    """Turned by a quarter, the nose points to image right; the figure fills the picture as it does from the front."""
    out = tmp_path / "side.exr"
    options = ["--size", 64, "--rays", 4, "--up", "+z", "--front=-y", "--yaw", 90, "--pitch", -8, "--focal", 85]
    assert run(mesh, "-o", out, *options).exit_code == 0
    maps = read_maps(out)
    rows, columns = np.nonzero(maps.mask)
    assert (rows.min(), rows.max()) == (3, 60) and 3 < rows[columns == columns.max()].mean() < 20
    assert maps.info["camera"] == "perspective" and maps.info["view"]["pitch"] == -8


def test_errors_name_their_cause(mesh, tmp_path):
    far = trimesh.creation.box()
    far.apply_translation([9, 0, 0])
    far.export(tmp_path / "far.ply")
    trimesh.creation.box((1e-4, 1, 1e-4)).export(tmp_path / "thread.ply")
    for arguments, words in (
        ((tmp_path / "none.obj",), "none.obj"),
        ((mesh, "-o", "a.tif"), "a.tif"),
        ((mesh, "-o", tmp_path / "thread.ply" / "a.exr"), "thread.ply is a file: give a folder"),
        ((mesh, "-o", "a.npz", "--yaw", "5"), "--yaw is for maps"),
        ((mesh, "--as-is", "--front", "+x"), "--front aligns the mesh, which --as-is leaves"),
        ((tmp_path / "far.ply", "--as-is"), "sees nothing.*align it first"),
        ((tmp_path / "thread.ply", "--size", "16", "--rays", "1"), "sees nothing.*thinner than the pixels.*16 x 16"),
        ((mesh, "--focal", "5"), "focal is 5.0: it must be a finite number from 10"),
    ):
        with pytest.raises(UserError, match=words):
            run(*arguments)
    ply, look = tmp_path / "textured.ply", tmp_path / "look.png"
    floats = "".join(f"property float {name}\n" for name in "xyzst")
    header = f"ply\nformat ascii 1.0\ncomment TextureFile look.png\nelement vertex 3\n{floats}element face 1\n"
    rows = "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    ply.write_text(f"{header}property list uchar int vertex_indices\nend_header\n{rows}")
    Image.new("RGB", (2, 2), "red").save(look)
    before = ply.read_bytes(), look.read_bytes()
    for target, what in ((ply, "the mesh itself"), (look, "a texture of the mesh")):
        with pytest.raises(UserError, match=f"is {what}"):
            run(ply, "-o", target)
    assert (ply.read_bytes(), look.read_bytes()) == before


def test_faces_turned_both_ways_are_told_of(tmp_path):
    box, path = trimesh.creation.box(), tmp_path / "box.ply"
    box.faces = np.concatenate([box.faces, box.faces[:2, ::-1]])
    path.write_bytes(trimesh.exchange.ply.export_ply(box))
    options = ["-o", tmp_path / "a.exr", "--size", 16, "--rays", 1]
    told = "2 faces coincide with faces of opposite orientation, so vertex normals cancel; "
    assert told + "omit --as-is" in run(path, *options, "--as-is").output
    assert told + "remove them" in run(path, *options, "-o", tmp_path / "a.npz").output
    assert "coincide with faces" not in run(path, *options).output
