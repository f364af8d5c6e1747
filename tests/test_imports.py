"""Packages: their entry points exist and cost nothing until they are used; no module imports itself in a circle, and no
package one of a higher layer."""

import ast
import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec, resolve_name
from pathlib import Path

import pytest

import relight

ROOT = Path(relight.__file__).parent
PACKAGES = ("lights", "maps", "meshes", "panoramas", "transport")


@pytest.mark.parametrize("name", PACKAGES)
def test_entry_points(name):
    package = import_module(f"relight.{name}")
    assert package.__all__ == dir(package)
    for entry in package.__all__:
        assert getattr(package, entry).__module__.startswith(f"relight.{name}.")
        assert find_spec(f"relight.{name}.{entry}") is None, f"importing the module {entry} would hide the entry point"
    with pytest.raises(AttributeError, match="no attribute 'missing'"):
        package.missing  # noqa: B018


def test_packages_import_nothing_heavy():
    program = f"import sys; {'; '.join(f'import relight.{name}' for name in PACKAGES)}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "torch", "open3d", "pymeshlab", "OpenEXR"} & set(loaded)


def imported(module: str, tree: ast.Module) -> set[str]:
    """Modules of relight that a module imports when it is imported itself; an entry point is its module."""
    found = set()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "relight":
            for alias in node.names:
                entry = f"{node.module}.{alias.name}"
                if find_spec(resolve_name(node.module, None)).submodule_search_locations is None:
                    found.add(node.module)
                elif find_spec(entry):
                    found.add(entry)
                else:
                    found.add(getattr(getattr(import_module(node.module), alias.name), "__module__", node.module))
    return found - {module}


def test_no_circular_imports():
    modules = {".".join(("relight", *p.relative_to(ROOT).with_suffix("").parts)): p for p in ROOT.rglob("*.py")}
    modules = {name: path for name, path in modules.items() if path.stem not in ("__init__", "__main__")}
    graph = {name: imported(name, ast.parse(path.read_text(encoding="utf-8"))) for name, path in modules.items()}
    while leaves := [name for name, targets in graph.items() if not targets & graph.keys()]:
        for name in leaves:
            del graph[name]
    assert not graph, f"modules in circles, or that import such: {sorted(graph)}"


@pytest.mark.parametrize(("package", "heading"), [
    ("relight", "* **Layers**"),
    ("relight.figures", "`relight/figures`"),
    ("relight.photos", "`relight/photos`"),
    ("relight.pictures", "`relight/pictures`"),
    ("relight.evaluation", "`relight/evaluation`:"),
])  # fmt: skip
def test_packages_import_only_from_lower_layers(package, heading):
    """Also inside functions, and as strings for import_module. The layers are those of CONTRIBUTING.md, which lists
    every part of a package."""
    listed = (ROOT.parent / ".github" / "CONTRIBUTING.md").read_text().partition(heading)[2].split("```")[1]
    layer = {name: number for number, line in enumerate(listed.strip().splitlines()) for name in line.split()}
    depth = package.count(".") + 1
    folder = ROOT.parent.joinpath(*package.split("."))
    parts = {path.stem for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    assert layer.keys() == parts - {"__init__"}
    upward = []
    for path in folder.rglob("*.py"):
        part = path.relative_to(folder).with_suffix("").parts[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if part in layer else ():
            names: list[str] = []
            if isinstance(node, ast.ImportFrom):
                names = [f"{node.module}", *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Constant) and re.fullmatch(r"relight(\.\w+)+", str(node.value)):
                names = [str(node.value)]
            inside = [name.split(".")[depth] for name in names if name.startswith(f"{package}.")]
            used = {*inside} & layer.keys() - {part}
            upward += [f"{path.relative_to(folder)} imports {name}" for name in used if layer[name] >= layer[part]]
    assert not upward
