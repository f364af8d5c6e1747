"""Progress shows the time left, and short work prints nothing."""

import itertools

import relight.core.progress
from relight.core.progress import progress


def test_lines_with_time_left_and_none_when_short(monkeypatch, capsys):
    assert list(progress(iter("abc"), "split")) == list("abc") and capsys.readouterr().err == ""
    clock = itertools.count(2.0, 2.0)  # two seconds at each call
    monkeypatch.setattr(relight.core.progress.time, "monotonic", lambda: next(clock))
    assert list(progress(range(10), "bake")) == list(range(10))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "bake 3/10, 14 s left" and lines[-1].startswith("bake 10/10, took")  # 2 s an item
