"""Writes the locks from pyproject.toml: constraints.txt, requirements.txt with hashes, and environment.yml."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

# Releases with which the numbers in docs/ were measured; update both together.
PINS = "torch==2.13.0\n"
# torch and the packages of its CUDA builds: a machine may need another build (CPU, another CUDA) of the same version,
# with other hashes.
OWN_BUILD = re.compile(r"(torch|triton|cuda-[\w-]+|nvidia-[\w-]+)==")

CONSTRAINTS = "# Exact versions of everything, from pyproject.toml by `make lock`; used as pip's constraints.\n"
REQUIREMENTS = """\
# What `make` installs, with the hashes of every file of these versions, by `make lock`; for pip's --require-hashes.
# torch and its CUDA libraries are not here: docs/reliability.md#what-is-installed says why.
"""
ENVIRONMENT = """\
# conda env create -f environment.yml: the versions of constraints.txt, which `make` installs too.
name: relight
channels: [conda-forge]
dependencies:
  - python=3.11
  - pip
  - pip:
      - --constraint constraints.txt
      - --editable .[dev]
"""


def compiled(extras: tuple[str, ...], constraints: str, *options: str) -> str:
    """Returns the lock of pyproject.toml with some extras, for all platforms and Python versions."""
    command = [sys.executable, "-m", "uv", "pip", "compile", "pyproject.toml"]
    command += [f"--extra={extra}" for extra in extras]
    command += ["--universal", "--no-header", "--no-annotate", "--python-version=3.11", "--quiet"]
    done = subprocess.run([*command, "-c", constraints, *options], check=True, capture_output=True, text=True)
    return done.stdout


def packages(text: str) -> list[str]:
    """Returns the entries of a lock, each with the lines of its hashes."""
    return re.findall(r"^\S.*(?:\n[ \t]+.*)*\n", text, re.M)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        pins = Path(folder) / "pins.txt"
        pins.write_text(PINS)
        text = compiled(("dev", "docs", "slurm", "postgres", "bench", "export"), str(pins))
        # Without local build tags, so that pip can choose the CUDA build or the CPU build.
        Path("constraints.txt").write_text(CONSTRAINTS + re.sub(r"(==[\w.]+)\+[\w.]+", r"\1", text))
        hashed = compiled(("dev",), "constraints.txt", "--generate-hashes")
    kept = [package for package in packages(hashed) if not OWN_BUILD.match(package)]
    Path("requirements.txt").write_text(REQUIREMENTS + "".join(kept))
    Path("environment.yml").write_text(ENVIRONMENT)


if __name__ == "__main__":
    main()
