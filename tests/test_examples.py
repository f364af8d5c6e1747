"""The examples in docstrings."""

import doctest
from importlib import import_module
from pathlib import Path

import pytest

import relight

ROOT = Path(relight.__file__).parent
FILES = [path for path in sorted(ROOT.rglob("*.py")) if ">>>" in path.read_text(encoding="utf-8")]
MODULES = [".".join(("relight", *path.relative_to(ROOT).with_suffix("").parts)) for path in FILES]


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    failed, tried = doctest.testmod(import_module(name))
    assert tried and not failed
