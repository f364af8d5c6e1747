"""What relight writes, by the programs that other people judge such files with; without one, its test is skipped.

`npm install gltf-validator vnu-jar` brings two of them; NODE_PATH says where, as for node. vnu needs java.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from samples import mesh_of, random_maps, snowman

from relight.maps import write_maps
from relight.meshes import read_mesh
from relight.pictures.video import write_video
from relight.transport.vertices import bake_vertices
from relight.viewer.build import build_viewer
from relight.viewer.figure import Figure

TETRAHEDRON = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
VALIDATE = """
const { validateBytes } = require("gltf-validator");
validateBytes(new Uint8Array(require("fs").readFileSync(process.argv[1]))).then((report) => console.log(
    JSON.stringify(report.issues)));
"""


def judge(program: str, *words: object) -> str:
    """Returns what a program prints; skips the test where it is not installed."""
    if shutil.which(program) is None:
        pytest.skip(f"no {program} on this machine")
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if "Cannot find module 'gltf-validator'" in done.stderr:
        pytest.skip("no gltf-validator on this machine")
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def loose(corner, bounces=0):
    return bake_vertices(mesh_of([*TETRAHEDRON, [corner, 5, 5]], FACES), 4, bounces=bounces)


def of_quads(folder):
    trimesh.Trimesh([*TETRAHEDRON, [2, 2, 2], [2, 2, 2]], [*FACES, [4, 5, 4]], process=False).export(folder / "a.ply")
    return bake_vertices(read_mesh(folder / "a.ply"), 4, order=3)


BALL = trimesh.creation.icosphere(2)
MESHES = {
    "a vertex that no face uses": lambda folder: loose(5),
    "and is no number": lambda folder: loose(np.nan),
    "and bounces": lambda folder: loose(5, 1),
    "a face without an area": of_quads,
    "a ball": lambda folder: bake_vertices(mesh_of(BALL.vertices, BALL.faces), 4, order=0),
}


@pytest.mark.parametrize("name", MESHES)
def test_the_validator_of_gltf_finds_no_error(tmp_path, name):
    MESHES[name](tmp_path).save(tmp_path / "a.glb")
    issues = json.loads(judge("node", "-e", VALIDATE, tmp_path / "a.glb"))
    assert not issues["numErrors"] and not issues["numWarnings"], issues["messages"]


def test_the_checker_of_the_w3c_finds_no_error(tmp_path):
    build_viewer(tmp_path / "a.html", [Figure("Balls", snowman(64, 0))], {"Even": np.eye(9, 3)})
    jars = [Path(folder, "vnu-jar/build/dist/vnu.jar") for folder in os.environ.get("NODE_PATH", "").split(os.pathsep)]
    if not (jar := next(filter(Path.is_file, jars), None)):
        pytest.skip("no vnu on this machine")
    newer_than_vnu = ".*container-type.*"  # a property of CSS that browsers have since 2023
    judge("java", "-jar", jar, "--errors-only", "--filterpattern", newer_than_vnu, tmp_path / "a.html")


@pytest.mark.parametrize(("suffix", "codec"), [(".mp4", "h264"), (".webm", "vp9"), (".gif", "gif")])
def test_ffprobe_reads_all_frames_and_their_colors(tmp_path, suffix, codec):
    write_video(tmp_path / f"a{suffix}", [np.full((48, 64, 3), 20 * i, np.uint8) for i in range(10)], 20)
    words = "-v error -count_frames -select_streams v -show_streams -show_format -of json".split()
    read = json.loads(judge("ffprobe", *words, tmp_path / f"a{suffix}"))
    (stream,) = read["streams"]
    assert (stream["codec_name"], stream["nb_read_frames"], stream["r_frame_rate"]) == (codec, "10", "20/1")
    assert float(read["format"]["duration"]) == pytest.approx(0.5, abs=0.01)
    if codec != "gif":
        colors = [stream[f"color_{name}"] for name in ("space", "transfer", "primaries", "range")]
        assert colors == ["bt709", "bt709", "bt709", "tv"]


def test_exrinfo_reads_the_maps(tmp_path):
    write_maps(tmp_path / "a.exr", random_maps(size=16, bounced=True))
    assert "L2M2" in judge("exrinfo", "-s", "-v", tmp_path / "a.exr")
