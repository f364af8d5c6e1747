"""Writes constraints.txt (exact versions, all platforms) from pyproject.toml, and environment.yml with the same."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

# Releases that everything was measured with; raise them with the numbers in docs/.
PINS = "torch==2.13.0\n"

HEAD = "# Exact versions of everything, from pyproject.toml by `make lock`; used as pip's constraints.\n"
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


def main() -> None:
    extras = [f"--extra={extra}" for extra in ("dev", "docs", "slurm", "bench", "export")]
    command = [sys.executable, "-m", "uv", "pip", "compile", "pyproject.toml", *extras]
    command += ["--universal", "--no-header", "--no-annotate", "--python-version=3.11", "--quiet"]
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as pins:
        pins.write(PINS)
        pins.flush()
        text = subprocess.run([*command, "-c", pins.name], check=True, capture_output=True, text=True).stdout
    # No local build tag: the same line takes the CUDA build where there is one, and the CPU build where pip prefers it.
    Path("constraints.txt").write_text(HEAD + re.sub(r"(==[\w.]+)\+[\w.]+", r"\1", text))
    Path("environment.yml").write_text(ENVIRONMENT)


if __name__ == "__main__":
    main()
