"""The hashes of the code that a job has run: what changes them, and what does not."""

import ast
import hashlib
import math
import subprocess
import sys

import pytest

from relight.lab import code
from relight.settings import ROOT

IMPORT = "from relight.transport.baker import bake\n"
# A package with a module, data and a stub.
FILES = {"__init__.py": IMPORT, "__init__.pyi": IMPORT, "baker.py": "def bake():\n    return 1\n", "table.csv": "1\n"}


@pytest.mark.parametrize(("name", "text", "differ"), [
    ("transport/baker.py", "def bake():\n    return 2\n", "transport.baker"),
    ("transport/baker.py", '"""Bakes."""\n\ndef bake():\n    """Bakes."""\n    return (1)  # one\n', ""),
    ("transport/__init__.py", "from relight.transport.baker import cook\n", "transport"),
    ("transport/__init__.pyi", "from relight.transport.baker import cook\n", ""),
    ("transport/table.csv", "2\n", "transport"),
    ("transport/templates/page.md", "2\n", "transport"),
    ("transport/.table.csv.swp", "2\n", ""),
    ("transport/more/__init__.py", "", ""),
    ("transport/more/table.csv", "2\n", "transport"),
    ("weights/network.onnx", "2\n", ""),
])  # fmt: skip
def test_a_hash_is_of_code_and_of_the_data_beside_it(tmp_path, monkeypatch, request, name, text, differ):
    modules, root = ("relight.transport", "relight.transport.baker"), tmp_path / "relight"
    (root / "transport").mkdir(parents=True)
    for file, content in FILES.items():
        (root / "transport" / file).write_text(content)
    monkeypatch.setattr(code, "ROOT", tmp_path)
    monkeypatch.setattr(code, "BEGUN", math.inf)
    request.addfinalizer(code.code_hash.cache_clear)

    def hashes() -> list[str]:
        code.code_hash.cache_clear()
        return [code.code_hash(module) for module in modules]

    before = hashes()
    assert before == hashes() and "" not in before
    (root / name).parent.mkdir(exist_ok=True)
    (root / name).write_text(text)
    changed = [module for module, *pair in zip(modules, before, hashes()) if pair[0] != pair[1]]
    assert changed == ([f"relight.{differ}"] if differ else [])
    assert code.code_hash("relight.transport.gone") == "" == code.code_hash("nobody.has.this")


SOURCE = r'''"""Module."""
# one
@kept(1, *a, **b)
class A(B, metaclass=C):
    """Class

    of two lines."""  # two

    x: int = (1)  # three

    async def f(self, /, a, *b, c=1e-3, **d) -> "A":
        names = [f"{x!r:>{width}.3f}{y=:}" f"{a}z{b:}" "\U0001fae8\n" async for x in y if not x]
        return names, {**a}, b"\\0", ..., None

    def g(self): "doc"

    def h(self):
        x
        "not a docstring"
        match x:
            case [A(y=1), *_] | {"a": None, **rest}: yield from lambda: (z := -x[1:, ::2])
        try:
            with a as b, c: raise D from None
        except* E as e: pass
'''


def test_the_syntax_is_the_same_in_all_versions_of_python():
    """Of which the tests run in several; an early 3.12 has empty parts in strings, and 3.13 leaves out empty lists."""
    assert hashlib.sha256(code.syntax(ast.parse(SOURCE)).encode()).hexdigest()[:16] == "d64304b933c8f87c"


@pytest.mark.parametrize(("old", "new", "same"), [
    ("# one", "# 1", True),
    ("of two lines", "of 2 lines", True),
    ('"doc"', '"another"', True),
    ("(1)  # three", "1\n\n\n", True),
    ("not a docstring", "not a doc", False),
    ("1e-3", "1e-4", False),
    ("z{b:}", "{b:}", False),
    ("B, metaclass", "metaclass", False),
    ("async for", "for", False),
    ("except*", "except", False),
    ("-x[1:,", "x[1:,", False),
    ("{**a}", "{**b}", False),
])  # fmt: skip
def test_only_what_a_result_can_depend_on_changes_the_syntax(old, new, same):
    assert old in SOURCE
    texts = [code.syntax(ast.parse(source)) for source in (SOURCE, SOURCE.replace(old, new))]
    assert (texts[0] == texts[1]) == same


def test_extensions_count_with_the_modules_that_they_import(tmp_path, monkeypatch):
    """Files in relight/extensions, and modules of a package that is installed beside relight."""
    (other := tmp_path / "other").mkdir()
    for name in ("__init__", "relighting", "helper", "late"):
        (other / f"{name}.py").write_text("from . import helper\n" if name == "relighting" else "")
    words = f"""
import importlib, json, sys
sys.path.insert(0, {str(tmp_path)!r})
from relight import extensions
from relight.lab.code import code_hash, code_of
extensions.installed = lambda: {{"mine": "other.relighting"}}
extensions.extension.__globals__["installed"] = extensions.installed
try:
    extensions.extension("mine", "loss")
except Exception as error:
    print("defines no" in str(error))
import relight.sh.harmonics
before = code_of("split")
open(sys.modules["other.helper"].__file__, "a").write("X = 1")
import other.late
open(other.late.__file__, "a").write("X = 1")
after = code_of("split")  # which does not know what other.late was when it was imported
print(*before, all(before.values()) and after == {{**before, "other.late": ""}})
"""
    done = subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True, check=True)
    refused, *found, same = done.stdout.split()
    assert (refused, found[-1], same) == ("True", "workflow.scripts.split", "True")
    assert found[:3] == ["other", "other.helper", "other.relighting"]
    assert "relight.sh.harmonics" in found and not {"relight", "relight.lab.code", "relight.core.errors"} & {*found}
