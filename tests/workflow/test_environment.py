"""pip's lock, conda's environment and pyproject.toml say the same."""

import re
import subprocess
import tomllib

import pytest
import yaml
from packaging.requirements import Requirement

from relight.config import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PINS = [Requirement(line) for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
OPTIONAL_LOCKED = ("dev", "slurm", "bench", "export")


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
    assert "--constraint constraints.txt --editable '.[dev]'" in (ROOT / "Makefile").read_text()
    python = next(item for item in environment["dependencies"] if str(item).startswith("python="))
    assert Requirement(f"python{PROJECT['requires-python']}").specifier.contains(python.removeprefix("python=") + ".0")


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
