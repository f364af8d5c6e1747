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
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "eve.ply")])
    assert checked.exit_code == 0, checked.exception
    assert "5280 faces" in checked.output and "+y up, facing +z" in checked.output and "parts: 10" in checked.output


def test_pick_writes_the_table_that_the_list_reads(tmp_path, person):
    folder = tmp_path / "00005" / "shortlong_hips"
    folder.mkdir(parents=True)
    for frame in range(6):
        arm = ((0.27 + 0.05 * frame, 1.1, 0), (0.05 + 0.05 * frame, 0.35, 0.05))
        write(folder / f"shortlong_hips.{frame:06d}.ply", person(4, left_arm=arm))
    result = CliRunner().invoke(app, ["pick", str(tmp_path), "--count", "2"])
    assert result.exit_code == 0 and result.output == f"2 frames in {tmp_path / 'scans.csv'}\n"
    assert len(CliRunner().invoke(app, ["list", str(tmp_path)]).output.splitlines()) == 2
