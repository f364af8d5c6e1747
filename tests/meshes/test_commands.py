"""`relight scans` from the command line."""

import numpy as np
import trimesh
from typer.testing import CliRunner

from relight.meshes.commands import app


def write(path, mesh):
    color = ((mesh.vertices / 2).clip(0, 1) * 255).astype(np.uint8)
    trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=color, process=False).export(path)


def test_list_and_check(tmp_path, person):
    write(tmp_path / "eve.ply", person())
    listed = CliRunner().invoke(app, ["list", str(tmp_path)])
    assert listed.exit_code == 0 and listed.output.split() == ["eve", "eve", str(tmp_path / "eve.ply")]
    checked, each = (CliRunner().invoke(app, ["check", str(path)]) for path in (tmp_path / "eve.ply", tmp_path))
    assert checked.exit_code == 0 and checked.output == each.output, checked.exception
    assert "5280 faces" in checked.output and "+y up, facing +z" in checked.output and "parts: 10" in checked.output
    assert "eve.ply --up +y --front +z --out eve_maps.png --rays 16" in checked.output  # not over a texture eve.png
    (tmp_path / "scans.csv").write_text("path,name,front,turn\neve.ply,Eva,-z,90\n")
    assert "--front -z --yaw 90" in CliRunner().invoke(app, ["check", str(tmp_path)]).output


def test_a_damaged_scan_does_not_end_the_check_of_its_folder(tmp_path, person):
    write(tmp_path / "eve.ply", person())
    (tmp_path / "adam.ply").write_bytes(b"ply")
    write(tmp_path / "{eve}.ply", person())  # which a run leaves out
    checked = CliRunner().invoke(app, ["check", str(tmp_path)])
    assert "adam.ply" in checked.output and "eve.ply: 5280 faces" in checked.output
    assert "{eve}.ply: rename it" in checked.output and str(checked.exception) == "2 of 3 scans cannot be used"
