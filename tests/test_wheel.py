"""What an installed wheel can do outside of the repository."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import trimesh

ROOT = Path(__file__).parents[1]
PROGRAM = """
import sys
from pathlib import Path
import relight
from relight.cli import app
from relight.core.errors import UserError
assert Path(relight.__file__).is_relative_to(sys.argv[1]), relight.__file__
for line in sys.argv[2:]:
    app(line.split(), standalone_mode=False)
try:
    app(["run"], standalone_mode=False)
except UserError as error:
    print(error)
"""


@pytest.mark.slow
def test_the_tools_work_from_a_wheel(tmp_path):
    pytest.importorskip("hatchling")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(installed := tmp_path / "site")
    trimesh.creation.icosphere(2, radius=0.9).export(tmp_path / "ball.obj")
    lines = ["bake ball.obj --size 32 --rays 16", "view ball.exr -l room:1", "scans check ball.obj"]
    lines.append("light numbers key:#ffeedd@45,30 --out light.json")
    command = [sys.executable, "-c", PROGRAM, str(installed), *lines]
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert {"ball.exr", "ball.html", "light.json"} <= {path.name for path in tmp_path.iterdir()}
    assert "needs the repository" in done.stdout
    assert (installed / "relight" / "py.typed").is_file()  # for type checkers
