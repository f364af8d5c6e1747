"""The JavaScript of the viewer by its own tests and lint, where node and eslint are on this machine."""

import shutil
import subprocess
from pathlib import Path

import pytest

from relight.viewer.build import PAGE

TESTS = Path(__file__).parent / "web"


def run(*words, folder):
    program = shutil.which(words[0])
    if program is None:
        pytest.skip(f"no {words[0]} on this machine")
    done = subprocess.run([program, *words[1:]], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]


def test_javascript_passes_its_own_tests():
    run("node", "--test", *map(str, sorted(TESTS.glob("*.test.js"))), folder=TESTS)


def test_javascript_passes_its_lint():
    run("eslint", ".", folder=PAGE.parent)
