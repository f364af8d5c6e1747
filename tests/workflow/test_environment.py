"""pip's lock, conda's environment and pyproject.toml say the same."""

import os
import re
import shutil
import subprocess
import sys
import time
import tomllib

import pytest
import yaml
from packaging.requirements import Requirement

from relight.config import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
HASHED = re.findall(r"^(\S+)==(\S+?)( ; .*)? \\\n((?: +--hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)",
                    (ROOT / "requirements.txt").read_text(), re.M)  # fmt: skip
PINS = [Requirement(line) for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
OPTIONAL_LOCKED = ("dev", "slurm", "postgres", "bench", "export")


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def wanted() -> list[Requirement]:
    extras = [line for extra in OPTIONAL_LOCKED for line in PROJECT["optional-dependencies"][extra]]
    found = [Requirement(line) for line in PROJECT["dependencies"] + extras]
    return [requirement for requirement in found if requirement.name != PROJECT["name"]]


@pytest.mark.parametrize("requirement", wanted(), ids=lambda requirement: requirement.name)
def test_each_dependency_is_locked_within_its_range(requirement):
    pins = [pin for pin in PINS if canonical(pin.name) == canonical(requirement.name)]
    assert pins, f"constraints.txt has no {requirement.name}: make lock"
    for pin in pins:
        (version,) = pin.specifier
        assert version.operator == "==" and "+" not in version.version
        assert requirement.specifier.contains(version.version, prereleases=True)


def test_conda_installs_what_pip_installs():
    environment = yaml.safe_load((ROOT / "environment.yml").read_text())
    pip = next(item["pip"] for item in environment["dependencies"] if isinstance(item, dict))
    assert "--constraint constraints.txt" in pip and "--editable .[dev]" in pip
    python = next(item for item in environment["dependencies"] if str(item).startswith("python="))
    assert Requirement(f"python{PROJECT['requires-python']}").specifier.contains(python.removeprefix("python=") + ".0")


def test_make_installs_by_hash_what_is_locked():
    """Each line of requirements.txt is a pin with hashes, of the version in constraints.txt; only torch is without."""
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    assert len(HASHED) == sum(not line.startswith(("#", " ")) for line in lines) > 150
    pins = {(canonical(pin.name), str(pin.specifier)) for pin in PINS}
    hashed = {(canonical(name), f"=={version}") for name, version, _, _ in HASHED}
    assert hashed <= pins
    names = {name for name, _ in hashed}
    needed = [Requirement(line) for line in PROJECT["dependencies"] + PROJECT["optional-dependencies"]["dev"]]
    assert {canonical(requirement.name) for requirement in needed} - names == {"torch", PROJECT["name"]}
    assert not any(re.match("triton|cuda-|nvidia-", name) for name in names)
    rules = (ROOT / "Makefile").read_text()
    assert "--require-hashes --no-deps --requirement requirements.txt" in rules
    assert "--constraint constraints.txt torch" in rules


def test_licences_of_all_packages_are_told():
    """And that of pymeshlab, which binds who passes it on, where one looks first."""
    listed = re.findall(r"^\| ([\w.-]+) \| \S+ \| (.+?) \|", (ROOT / "docs" / "licences.md").read_text(), re.M)
    told = {canonical(name): licence for name, licence in listed}
    others = (ROOT / "docs" / "licences.md").read_text().rpartition("\n\n")[2]
    assert not [name for name, *_ in HASHED if canonical(name) not in told and name not in others]
    assert told["torch"] and told["pymeshlab"].startswith("GPL") and "not stated" not in told.values()
    for page in ("README.md", "NOTICE"):
        text = (ROOT / page).read_text()
        assert "pymeshlab" in text and re.search(r"GPL-3|General Public License, version 3", text)


def test_console_scripts_exist():
    import importlib

    for target in PROJECT["scripts"].values():
        module, _, attribute = target.partition(":")
        found = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
        assert callable(found)


def test_the_container_installs_what_pip_installs():
    text = (ROOT / "Dockerfile").read_text()
    assert "--constraint constraints.txt --editable ." in text and "python workflow/scripts/system.py" in text
    copied = [word for words in re.findall(r"^COPY (.+) \S+$", text, re.M) for word in words.split()]
    assert len(copied) == 7 and all((ROOT / path).exists() for path in copied)
    version = re.search(r"^FROM python:([\d.]+)", text, re.M)[1]
    assert Requirement(f"python{PROJECT['requires-python']}").specifier.contains(version + ".0")
    expression = re.search(r"sed -n '([^']+)' constraints.txt", text)[1]
    found = subprocess.run(
        ["sed", "-n", expression, ROOT / "constraints.txt"], capture_output=True, text=True, check=True
    )
    (torch,) = (str(pin.specifier) for pin in PINS if pin.name == "torch")
    assert found.stdout.split()[0] == torch.removeprefix("==")


@pytest.mark.parametrize("profile", ["default", "slurm", "kubernetes"])
def test_profiles_ask_for_what_snakemake_knows(profile):
    """Each key is an option of Snakemake's, or of the executor that the profile names."""
    from snakemake.cli import get_argument_parser

    settings = yaml.safe_load((ROOT / "profiles" / profile / "config.yaml").read_text())
    known = {option.lstrip("-") for action in get_argument_parser()._actions for option in action.option_strings}
    own = f"{settings.get('executor', 'none')}-"
    assert not [key for key in settings if key not in known and not key.startswith(own) and "status" not in key]


PYTHON = """#!/bin/sh
# Stands for the Python that installs, and is its own virtual environment. It installs when there is a file `go`.
case "$1" in
-m) mkdir -p .venv/bin && cp "$0" .venv/bin/python
    echo "begin $2 $3" >> log; while ! [ -e go ]; do sleep 0.05; done; echo "end $2 $3" >> log ;;
*) exec {python} "$@" ;;
esac
"""


@pytest.mark.skipif(not shutil.which("make"), reason="no make here")
def test_two_make_at_once_install_one_after_the_other(tmp_path):
    scripts = tmp_path / "workflow" / "scripts"
    scripts.mkdir(parents=True)
    for name in ("Makefile", "workflow/scripts/alone.py"):
        shutil.copy(ROOT / name, tmp_path / name)
    for name in ("pyproject.toml", "requirements.txt", "constraints.txt", "workflow/scripts/system.py"):
        (tmp_path / name).write_text("")
    (tmp_path / "python").write_text(PYTHON.format(python=sys.executable))
    (tmp_path / "python").chmod(0o755)
    plain = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ["make", "env", "PYTHON=./python"]

    def start() -> subprocess.Popen:
        return subprocess.Popen(command, cwd=tmp_path, env=plain, stdout=subprocess.PIPE, text=True)

    try:
        first = start()
        while not (tmp_path / "log").exists():  # the first make holds the lock once it installs
            assert first.poll() is None, first.communicate()[0]
            time.sleep(0.05)
        second = start()
        assert "another make is installing" in second.stdout.readline()
    finally:
        (tmp_path / "go").touch()
    told = [make.communicate()[0] for make in (first, second)]
    assert [first.returncode, second.returncode] == [0, 0], told
    done = ["venv .venv", *3 * ["pip install"]]
    assert (tmp_path / "log").read_text().splitlines() == [f"{end} {what}" for what in done for end in ("begin", "end")]


def test_only_make_clean_removes_results():
    """`make docs` and MkDocs empty the folders that they write to: none of them may hold a run."""
    recipes = re.split(r"^(?=[\w$()]+:)", (ROOT / "Makefile").read_text(), flags=re.M)
    removed = {recipe.split(":")[0]: re.findall(r"\brm -rf (.*?)(?:;|$)", recipe, re.M) for recipe in recipes}
    assert "results" in removed.pop("clean")[0].split()
    emptied = [word for lines in removed.values() for line in lines for word in line.split()]
    site = (ROOT / "mkdocs.yml").read_text()
    emptied += re.findall(r"^site_dir: (\S+)$", site, re.M) + re.findall(r"RELIGHT_DEMO, ([^\]]+)\]", site)
    assert len(emptied) >= 3 and not [folder for folder in emptied if folder.startswith("results")]
