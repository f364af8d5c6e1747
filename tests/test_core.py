"""What `pip install .` brings, without any extra, relights photos, and says what is missing for the rest."""

import json
import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, requires

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from PIL import Image

from relight.cli import EXTRAS
from relight.settings import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# Run before the command: packages that the core does not install cannot be imported.
GUARD = """
import json, sys
class Guard:
    hidden = frozenset(json.loads({hidden!r}))
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in self.hidden:
            raise ModuleNotFoundError("No module named " + repr(name), name=name)
sys.meta_path.insert(0, Guard())
"""


@cache
def distributions() -> dict[str, list[str]]:
    """Returns the packages that each module comes with; to list them takes a second."""
    return dict(packages_distributions())


def core_packages() -> set[str]:
    """Returns the names of the packages that the core needs, directly or not."""
    found: set[str] = set()
    queue = [Requirement(line) for line in PROJECT["dependencies"]]
    while queue:
        name = canonicalize_name(queue.pop().name)
        if name in found:
            continue
        found.add(name)
        try:
            needed = [Requirement(line) for line in requires(name) or []]
        except PackageNotFoundError:  # of another platform
            continue
        queue += [each for each in needed if each.marker is None or each.marker.evaluate({"extra": ""})]
    return found


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """The function that runs `relight` as where the core alone is installed, and returns the finished process."""
    allowed = {*core_packages(), "relight", "coverage"}
    hidden = [name for name, owners in distributions().items() if not {*map(canonicalize_name, owners)} & allowed]
    folder = tmp_path_factory.mktemp("core")
    (folder / "guard.py").write_text(GUARD.format(hidden=json.dumps(hidden)))
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", "RELIGHT_DATA": str(folder / "data")}

    def run(*words, program="from relight.cli import main; main()"):
        command = [sys.executable, "-c", f"import guard; {program}", *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)

    return run


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    web, folder = ROOT / "relight" / "viewer" / "web", tmp_path_factory.mktemp("photo")
    Image.open(web / "astronaut.jpg").resize((256, 256)).save(folder / "me.png")
    Image.open(web / "astronaut_mask.png").resize((256, 256)).save(folder / "me_mask.png")
    return folder / "me.png"


# Commands one after the other in one process; each ends with its exit code and the last line of its errors.
COMMANDS = """
import contextlib, io, json, sys
from relight.cli import main
for words in json.loads(sys.argv[1]):
    sys.argv, errors, code = ["relight", *words], io.StringIO(), 0
    with contextlib.redirect_stderr(errors):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
            if isinstance(code, str):
                code = print(code, file=sys.stderr) or 1
    print(json.dumps(["END", code, errors.getvalue().strip().rpartition("\\n")[2]]))
"""


def ends(done) -> list[tuple[int, str]]:
    """Returns exit code and last line of errors of each of COMMANDS."""
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith('["END"')]
    return [tuple(json.loads(line)[1:]) for line in lines]


@pytest.mark.slow
def test_commands_and_python_interface_of_the_core_run(core, photo):
    lines = "photo PHOTO --light lamps:5 --out relit --maps", "photo PHOTO --light PHOTO --out relit"
    lines += "view PHOTO --out me.html", "light room:7 --out room.json", "photo --help", "--help"
    commands = [line.replace("PHOTO", str(photo)).split() for line in lines]
    found = ends(core(json.dumps(commands), program=COMMANDS))
    assert [code for code, _ in found] == [0] * len(commands), found
    done = core(program=f"import relight; print(relight.load().relight({str(photo)!r}, light='room:12').shape)")
    assert done.stdout.strip() == "(256, 256, 3)", done.stderr


LACKING = {  # command -> the extra that it lacks
    "export a.safetensors a.onnx": "train",
    "bake MESH": "scans",
    "figures --seeds 0": "figures",
    "movie PHOTO --out a.mp4": "video",
    "run scale=smoke": "workflow",
    "ui": "tracking|workflow",
}


@pytest.mark.slow
def test_missing_extras_are_named_in_one_line(core, photo, tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    files = {"PHOTO": str(photo), "MESH": str(tmp_path / "a.obj")}
    commands = [[files.get(word, word) for word in line.split()] for line in LACKING]
    for extra, (code, told) in zip(LACKING.values(), ends(core(json.dumps(commands), program=COMMANDS)), strict=True):
        assert code == 1 and re.search(rf"needs \w+: run `pip install '\.\[({extra})\]'`", told), told


def test_every_extra_that_is_named_exists():
    assert {*EXTRAS.values()} <= {*PROJECT["optional-dependencies"]}
    for module, extra in EXTRAS.items():
        owners = {canonicalize_name(owner) for owner in distributions().get(module, [])}
        listed = {canonicalize_name(Requirement(line).name) for line in PROJECT["optional-dependencies"][extra]}
        assert not owners or owners & listed, f"{module} does not come with {extra}"


def test_no_module_of_the_core_imports_more(core):
    assert core(program="import torch").returncode
    packages = ("lights", "panoramas", "photos", "sh", "viewer")
    files = [path for package in packages for path in sorted((ROOT / "relight" / package).rglob("*.py"))]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files if path.stem != "__init__"]
    done = core(program="; ".join(f"import {name}" for name in [*names, "relight.cli", "relight.core.npz"]))
    assert done.returncode == 0, done.stderr
