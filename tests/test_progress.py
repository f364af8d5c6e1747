"""Progress shows the time left, and short stages print nothing."""

import pytest

import relight.core.progress
from relight.core.progress import progress


@pytest.fixture
def clock(monkeypatch):
    """A clock that steps by two seconds at each call."""
    now = [0.0]

    def monotonic():
        now[0] += 2.0
        return now[0]

    monkeypatch.setattr(relight.core.progress.time, "monotonic", monotonic)


def test_lines_with_time_left(clock, capsys):
    assert list(progress(range(10), "bake")) == list(range(10))
    lines = capsys.readouterr().err.splitlines()
    # 2 s an item: the first line after three of ten
    assert lines[0] == "bake 3/10, 14 s left"
    assert lines[-1].startswith("bake 10/10, took")


def test_quiet_when_short(capsys):
    assert list(progress(iter("abc"), "split")) == list("abc")
    assert capsys.readouterr().err == ""
