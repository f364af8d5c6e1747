"""What several files of tests share: one workflow that ran through."""

from pathlib import Path

import pytest
from repo import WORDS, copy, relight


@pytest.fixture(scope="session")
def done(once) -> Path:
    """A repository in which the workflow ran through, undisturbed; tests read it, and change nothing in it."""

    def fill(folder: Path) -> None:
        run = relight(copy(folder), "run", *WORDS)
        assert run.returncode == 0, run.stdout

    return once("undisturbed", fill) / "repo"
