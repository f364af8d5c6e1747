"""The hash of a stage's code: what changes it, what does not, and what a run says about it."""

import subprocess
import sys

import pytest

from relight import code
from relight.config import READS, ROOT, composed
from relight.config_folder import ConfigFolder, extension_names
from relight.errors import UserError
from relight.plan import Plan
from relight.run import change_lines


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of two stages: bake imports transport, which imports sampling; lights imports neither."""
    folder = tmp_path / "relight"
    files = {
        "stages/bake.py": "def main():\n    from relight.transport import bake\n    bake()\n",
        "stages/lights.py": "from relight.config import ROOT\n",
        "transport/__init__.py": "",
        "transport/__init__.pyi": "from relight.transport.baker import bake\n",
        "transport/baker.py": "import relight.npz\nimport relight.transport.sampling\ndef bake():\n    return 1\n",
        "transport/sampling.py": "N = 2\n",
        "transport/unused.py": "N = 2\n",
        "transport/table.csv": "1\n",
        "npz.py": "",
        "config/__init__.py": "ROOT = 1\n",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    monkeypatch.setattr(code, "ROOT", tmp_path)
    for cache in (code.source, code.cached, code.path_of):
        cache.cache_clear()
    yield folder
    for cache in (code.source, code.cached, code.path_of):
        cache.cache_clear()


def hashes() -> tuple[str, str]:
    for cache in (code.source, code.cached, code.path_of):
        cache.cache_clear()
    return code.code_hash("bake"), code.code_hash("lights")


def test_closure_follows_functions_stubs_and_plain_imports(package):
    names = {"relight.stages.bake", "relight.transport.baker", "relight.transport.sampling", "relight.npz"}
    assert code.closure("relight.stages.bake") == names


@pytest.mark.parametrize(
    ("name", "text", "bake_differs", "lights_differs"),
    [
        ("transport/sampling.py", "N = 3\n", True, False),
        (
            "transport/baker.py",
            "import relight.npz\nimport relight.transport.sampling\ndef bake():\n    return 2\n",
            True,
            False,
        ),
        ("transport/table.csv", "2\n", True, False),
        ("stages/lights.py", "from relight.config import ROOT\nX = 1\n", False, True),
        ("transport/sampling.py", '"""Samples."""\n\nN = 2  # two\n', False, False),
        ("transport/.table.csv.swp", "2\n", False, False),
        ("weights/network.onnx", "2\n", False, False),
        ("transport/templates/page.md", "2\n", True, False),
        ("transport/unused.py", "N = 3\n", False, False),
        ("config/__init__.py", "ROOT = 2\n", False, False),
    ],
)
def test_code_hash_changes_with_what_a_stage_runs_and_with_nothing_else(
    package, name, text, bake_differs, lights_differs
):
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
        "x = ' '.join(y)",
        "x = 'a\\n\\n  # no\\nb'",
        "x = f('not a docstring')",
        "def f():\n    x\n    'not a docstring'",
    ],
)
def test_without_comments_keeps_all_that_a_result_can_depend_on(source):
    assert code.without_comments(source) == source


def test_without_comments_drops_comments_docstrings_and_layout():
    source = '"""Module."""\n\n# one\nclass A:\n    """Class\n\n    of two lines."""  # two\n\n    x = (1)  # three\n'
    assert code.without_comments(source) == "class A:\n    x = 1"
    assert code.without_comments('def f(): "doc"; return 1') == "def f():\n    return 1"
    assert code.without_comments('def f():\n    "doc"') == "def f():\n    pass"


def test_code_hash_includes_the_extension_that_the_settings_name(tmp_path, monkeypatch):
    monkeypatch.setattr(code.extensions, "__path__", [str(tmp_path)])
    (tmp_path / "mine.py").write_text("def loss(outputs, batch): return 1\n")
    without, first = code.code_hash("split"), code.code_hash("split", frozenset({"mine"}))
    assert without != first
    code.source.cache_clear()
    (tmp_path / "mine.py").write_text("def loss(outputs, batch): return 22\n")
    assert code.code_hash("split", frozenset({"mine"})) != first
    code.source.cache_clear()


def test_results_named_like_an_extension_do_not_depend_on_it(tmp_path, monkeypatch):
    folder = ConfigFolder(Plan({"hydra": ["scale=smoke", "name=mine"]}))
    before = folder.stage_settings("report")
    (tmp_path / "mine.py").touch()
    monkeypatch.setattr(code.extensions, "__path__", [str(tmp_path)])
    assert folder.stage_settings("report") == before
    named = {"model": {"name": "a"}, "loss": {"extra": {"b": 1.0}}, "figures": {"source": "c"}}
    assert extension_names(named) == {"a", "b", "c"}


@pytest.mark.slow
def test_every_stage_imports_what_it_runs():
    """What a process of a stage has loaded of relight after its imports is in the closure, if results depend on it."""
    for stage in ("bake", "lights", "train"):
        words = f"import sys, relight.stages.{stage}; print(*[name for name in sys.modules if 'relight.' in name])"
        done = subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True, check=True)
        loaded = {name for name in done.stdout.split() if not code._has_no_results(name)}
        packages = {name for name in loaded if (code.path_of(name) or ROOT).name == "__init__.py"}
        assert loaded - packages <= code.closure(f"relight.stages.{stage}")
    assert {path.stem for path in (ROOT / "relight" / "stages").glob("*.py")} >= set(READS)


@pytest.fixture
def made(tmp_path, monkeypatch):
    """The settings of results that were made with the smoke scale."""
    monkeypatch.setattr("relight.config_folder.ROOT", tmp_path)
    config = tmp_path / "results" / "smoke" / "config"
    config.mkdir(parents=True)
    for stage in ("figure", "bake", "tables"):
        (config / f"{stage}.yaml").write_text(ConfigFolder(Plan({"hydra": ["scale=smoke"]})).stage_settings(stage))
    return config


def test_nothing_is_said_where_nothing_changed(made):
    assert change_lines(Plan({"hydra": ["scale=smoke"]})) == []


def test_changed_settings_are_named_with_the_way_to_keep_both(made):
    (line,) = change_lines(Plan({"hydra": ["scale=smoke", "bake.rays=64"]}))
    assert line.startswith("results/smoke was made with other settings (bake.rays): bake and what depends on them")
    assert line.endswith("to keep both, give this run a name, name=NAME")


def test_update_config_dates_the_settings_that_differ(made):
    """Snakemake has no records of a folder that was copied: the dates of these files alone tell it what to make."""
    (made / "bake.yaml~").write_bytes(b"an editor's copy \xff")
    dates = {file.name: file.stat().st_mtime_ns for file in made.iterdir()}
    folder = ConfigFolder(Plan({"hydra": ["scale=smoke", "bake.rays=64"]}))
    folder.update()
    assert {file.name for file in made.iterdir() if file.stat().st_mtime_ns > dates[file.name]} == {"bake.yaml"}
    assert (made / "bake.yaml").read_text() == folder.stage_settings("bake")


@pytest.mark.slow
def test_changed_code_is_named_and_pin_keeps_its_results(made):
    file = made / "bake.yaml"
    text = file.read_text()
    code_line = next(line for line in text.splitlines() if line.startswith("code:"))
    file.write_text(text.replace(code_line, "code: older"))
    (line,) = change_lines(Plan({"hydra": ["scale=smoke"]}))
    assert line.startswith("the code of bake has changed") and line.endswith("pin=[bake] keeps their results")
    pinned = Plan({"hydra": ["scale=smoke", "pin=[bake]"]})
    assert change_lines(pinned) == [] and "code: older" in ConfigFolder(pinned).stage_settings("bake")


def test_pin_of_no_stage_is_refused():
    with pytest.raises(UserError, match="pin: no stage baek; there are figure, "):
        composed(["pin=[baek]"])
