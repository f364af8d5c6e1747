"""The hash of a rule's code: what changes it, and what does not."""

import ast
import subprocess
import sys

import pytest

from relight.lab import code
from relight.settings import ROOT


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with two scripts: bake imports transport, which imports sampling; lights imports neither."""
    folder = tmp_path / "relight"
    files = {
        "../scripts/bake.py": "from relight.transport import bake\nbake()\n",
        "../scripts/lights.py": "from relight.settings import ROOT\nfrom relight.lights import chain\n",
        "lights/chain.py": "",
        "transport/__init__.py": "",
        "transport/__init__.pyi": "from relight.transport.baker import bake\n",
        "transport/baker.py": "import relight.core.npz\nimport relight.transport.sampling\ndef bake():\n    return 1\n",
        "transport/sampling.py": "N = 2\n",
        "transport/unused.py": "N = 2\n",
        "transport/table.csv": "1\n",
        "core/npz.py": "",
        "settings/__init__.py": "ROOT = 1\n",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    monkeypatch.setattr(code, "ROOT", tmp_path)
    monkeypatch.setattr(code, "SCRIPTS", tmp_path / "scripts")
    forget()
    yield folder
    forget()


def forget() -> None:
    for cache in (code.source, code.path_of, code._data):
        cache.cache_clear()


def hashes() -> tuple[str, str]:
    forget()
    return code.code_hash("bake"), code.code_hash("lights")


def test_closure_follows_functions_stubs_and_plain_imports(package):
    names = {"scripts/bake.py", "relight/transport/baker.py", "relight/transport/sampling.py", "relight/core/npz.py"}
    found = {str(path.relative_to(package.parent)) for path in code.closure([code.SCRIPTS / "bake.py"])}
    assert found == names | {"relight/transport/table.csv"}


@pytest.mark.parametrize(
    ("name", "text", "bake_differs", "lights_differs"),
    [
        ("transport/sampling.py", "N = 3\n", True, False),
        ("transport/table.csv", "2\n", True, False),
        ("lights/chain.py", "X = 1\n", False, True),
        ("transport/sampling.py", '"""Samples."""\n\nN = 2  # two\n', False, False),
        ("transport/.table.csv.swp", "2\n", False, False),
        ("weights/network.onnx", "2\n", False, False),
        ("transport/templates/page.md", "2\n", True, False),
        ("transport/unused.py", "N = 3\n", False, False),
        ("settings/__init__.py", "ROOT = 2\n", False, False),
    ],
)
def test_code_hash_changes_with_what_a_rule_runs_alone(package, name, text, bake_differs, lights_differs):
    bake, lights = hashes()
    assert hashes() == (bake, lights)
    (package / name).parent.mkdir(exist_ok=True)
    (package / name).write_text(text)
    again = hashes()
    assert (again[0] != bake, again[1] != lights) == (bake_differs, lights_differs)


@pytest.mark.parametrize(
    "source",
    [
        "x = '# no'\nif x:\n    y = 1\nz = 2",
        "x = 'a\\n\\n  # no\\nb'",
        "x = f('not a docstring')",
        "def f():\n    x\n    'not a docstring'",
    ],
)
def test_without_docstrings_keeps_all_that_a_result_can_depend_on(source):
    assert ast.unparse(code.without_docstrings(ast.parse(source))) == source


def test_without_docstrings():
    source = '"""Module."""\n\n# one\nclass A:\n    """Class\n\n    of two lines."""  # two\n\n    x = (1)  # three\n'
    assert ast.unparse(code.without_docstrings(ast.parse(source))) == "class A:\n    x = 1"
    assert ast.unparse(code.without_docstrings(ast.parse('def f():\n    "doc"'))) == "def f():\n    pass"


def test_code_hash_includes_the_extension_that_the_settings_name(tmp_path, monkeypatch):
    monkeypatch.setattr(code.extensions, "__path__", [str(tmp_path)])
    (tmp_path / "mine.py").write_text("def loss(outputs, batch): return 1\n")
    without, first = code.code_hash("split"), code.code_hash("split", ["mine"])
    assert without != first
    forget()
    hashes = {without, first}
    for words in ("from .helper import x", "from . import helper"):
        for value in (1, 2):
            (tmp_path / "mine.py").write_text(words)
            (tmp_path / "helper.py").write_text(f"x = {value}")
            hashes.add(code.code_hash("split", ["mine"]))
            forget()
    assert len(hashes) == 6


@pytest.mark.slow
def test_every_script_imports_what_it_runs():
    """What a process of a rule has loaded of relight after its imports is in the closure, if results depend on it."""
    for rule in ("bake", "lights", "train"):
        imports = "\n".join(line for line in (code.SCRIPTS / f"{rule}.py").read_text().splitlines() if "import" in line)
        words = f"import sys\n{imports}\nprint(*[name for name in sys.modules if 'relight.' in name])"
        done = subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True, check=True)
        loaded = {path for path in map(code.path_of, done.stdout.split()) if path and path.name != "__init__.py"}
        assert loaded <= code.closure([code.SCRIPTS / f"{rule}.py"])


PACKAGES = {
    "scan": "core meshes pictures",
    "figure": "core extensions figures meshes",
    "clean": "core meshes",
    "align": "core maps meshes sh",
    "bake": "core maps meshes sh transport",
    "pack": "core maps sh",
    "split": "core learning maps sh",
    "lights": "core extensions lights panoramas sh",
    "train": "core evaluation extensions lab learning lights maps panoramas photos sh",
    "evaluate": "core evaluation extensions lab learning lights maps panoramas photos sh",
    "baselines": "core evaluation extensions learning lights maps panoramas photos sh",
}


@pytest.mark.parametrize("rule", PACKAGES)
def test_a_rule_depends_on_its_packages_alone(rule):
    """For generated figures and lights. What a rule begins to import belongs here, or to UNUSED."""
    files = {str(path.relative_to(ROOT)) for path in code.files_of(rule, ["generated"])} - {
        f"workflow/scripts/{rule}.py"
    }
    assert {path.split("/")[1] for path in files} == {*PACKAGES[rule].split()}
    readers = files & {f"relight/{name}.py" for name in ("meshes/gltf", "meshes/obj", "panoramas/hdr")}
    assert not readers or rule == "scan"
