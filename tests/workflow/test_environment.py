"""uv's lock, conda's environment, the Makefile and pyproject.toml say the same."""

import json
import os
import re
import runpy
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from relight.settings import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = (ROOT / "uv.lock").read_text()
VERSIONS: dict[str, list[str]] = {}
for package in tomllib.loads(LOCK)["package"]:
    VERSIONS.setdefault(package["name"], []).append(package.get("version", ""))


EXTRAS = [line for lines in PROJECT["optional-dependencies"].values() for line in lines]
WANTED = [Requirement(line) for line in PROJECT["dependencies"] + EXTRAS]
WANTED = [requirement for requirement in WANTED if requirement.name not in (PROJECT["name"], "torch")]


@pytest.mark.parametrize("requirement", WANTED, ids=lambda requirement: requirement.name)
def test_each_dependency_is_locked_within_its_range(requirement):
    assert (versions := VERSIONS.get(canonicalize_name(requirement.name))), "make lock"
    assert all(requirement.specifier.contains(version, prereleases=True) for version in versions)


def test_pythons_are_the_same_everywhere():
    """pyproject.toml, uv.lock, make, the README, conda's environment and the tests of the hosting site name them."""
    pythons = re.findall(r"Python :: (3\.\d+)$", "\n".join(PROJECT["classifiers"]), re.M)
    first, last = pythons[0], pythons[-1]
    minor = int(last.removeprefix("3."))
    assert pythons == [f"3.{number}" for number in range(int(first.removeprefix("3.")), minor + 1)]
    assert PROJECT["requires-python"] == f">={first},<3.{minor + 1}"
    assert tomllib.loads(LOCK)["requires-python"] == f">={first}, <3.{minor + 1}"
    limits = runpy.run_path(str(ROOT / "tools" / "system.py"))["PYTHONS"]
    assert [".".join(map(str, limit)) for limit in limits] == [first, last]
    assert f"Python {first} to {last};" in (ROOT / "README.md").read_text()
    (conda,) = re.findall(r"- python=(\S+)", (ROOT / "environment.yml").read_text())
    assert conda in pythons
    assert f"python: {json.dumps(pythons)}" in (ROOT / ".github" / "workflows" / "test.yml").read_text()


def test_lock_has_one_version_of_a_package_and_hashes_every_file_of_the_public_index():
    assert {name: versions for name, versions in VERSIONS.items() if len(versions) > 1} == {}
    assert set(re.findall(r"https?://([^/\"]+)", LOCK)) == {"pypi.org", "files.pythonhosted.org"}
    files = re.findall(r"url = .*", LOCK)
    assert len(files) > 1000 and all(re.search(r'hash = "sha256:[0-9a-f]{64}"', line) for line in files)


def test_torch_is_pinned_by_its_version_alone():
    """Machines need different builds of it, so neither the lock nor the Makefile names one."""
    assert not [name for name in VERSIONS if re.match("torch$|triton|cuda-|nvidia-", name)]
    (pin,) = re.findall(r"^TORCH := (.*)$", (ROOT / "Makefile").read_text(), re.M)
    (version,) = Requirement(pin).specifier
    assert version.operator == "==" and "+" not in version.version
    extras = PROJECT["optional-dependencies"]
    needed = [Requirement(line) for extra in ("train", "export") for line in extras[extra] if line.startswith("torch")]
    assert len(needed) == 2 and all(requirement.specifier.contains(version.version) for requirement in needed)
    assert pin in (ROOT / "environment.yml").read_text()


def test_make_installs_uv_in_the_locked_version():
    """By the shell line of the Makefile; an empty line would install the newest."""
    shell = re.search(r"^UV := \$\(shell (.*)\)$", (ROOT / "Makefile").read_text(), re.M)[1].replace("$$", "$")
    found = subprocess.run(shell, shell=True, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert found == [f"uv=={VERSIONS['uv'][0]}"]


@pytest.mark.parametrize("user", ["root", "ann"])
def test_make_gets_system_libraries(tmp_path, monkeypatch, user):
    """As root it installs the packages; as another user it unpacks them, and all that they need, into .venv."""
    get = runpy.run_path(str(ROOT / "tools" / "system.py"))["get"]
    apt = f'echo "$@" >> {tmp_path}/calls; case "$*" in *download*) touch x.deb;; esac'
    dpkg = 'mkdir -p "$3/usr/lib/x86_64-linux-gnu"; touch "$3/usr/lib/x86_64-linux-gnu/libX11.so.6"'
    for name, script in (("apt-get", apt), ("dpkg-deb", dpkg)):
        (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(os, "geteuid", lambda: 0 if user == "root" else 1000)
    monkeypatch.chdir(tmp_path)
    Path(".venv", "lib").mkdir(parents=True)
    Path("temporary").mkdir()
    get(["libx11-6 libxcb1", "libusb-1.0-0"], tmp_path / "temporary")
    update, last = (tmp_path / "calls").read_text().splitlines()
    assert update.endswith(" update")
    if user == "root":
        assert last.endswith(" install -y --no-install-recommends libx11-6 libusb-1.0-0")
        assert "temporary" not in update + last and not list(Path(".venv", "lib").iterdir())
    else:
        assert last.endswith(" download libx11-6 libxcb1 libusb-1.0-0") and last.count(f"={tmp_path}/temporary") == 2
        assert [path.name for path in Path(".venv", "lib").iterdir()] == ["libX11.so.6"]


@pytest.mark.parametrize("has_one", [True, False])
def test_pip_is_the_one_of_python_or_else_of_the_distribution(tmp_path, monkeypatch, has_one):
    """Debian's is too old for a Python that is newer than Debian's."""
    pip = runpy.run_path(str(ROOT / "tools" / "system.py"))["pip"]
    monkeypatch.setitem(pip.__globals__, "find_spec", lambda name: has_one)
    wheel = tmp_path / "usr" / "share" / "python-wheels" / "pip-23.0.1-py3-none-any.whl"
    wheel.parent.mkdir(parents=True)
    if not has_one:
        with pytest.raises(SystemExit, match="no ensurepip: install python3-venv"):
            pip(tmp_path)
    wheel.touch()
    by_wheel = [f"{wheel}/pip", "install", "--no-index", str(wheel)]
    assert pip(tmp_path) == (["-m", "ensurepip"] if has_one else by_wheel)


def test_licences_of_all_packages_are_told():
    """And that of pymeshlab, which binds who passes it on, where one looks first."""
    tool = runpy.run_path(str(ROOT / "tools" / "licences.py"))
    page, names = tool["page"](), tool["locked"]()
    rows = re.findall(r"^\| ([\w.-]+) \| \S+ \| (.+?) \|", page, re.M)
    told = {canonicalize_name(name): licence for name, licence in rows}
    others = page.rpartition("\n\n")[2]
    assert len(names) > 150
    assert not [name for name in names if canonicalize_name(name) not in told and name not in others]
    assert told["torch"] and told["pymeshlab"].startswith("GPL") and "not stated" not in told.values()
    for page in ("README.md", "NOTICE"):
        text = (ROOT / page).read_text()
        assert "pymeshlab" in text and re.search(r"GPL-3|General Public License, version 3", text)
