"""Packages: their entry points exist and cost nothing until they are used; no module imports itself in a circle, and no
package one of a higher layer."""

import ast
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


def layer_of(module: str, layers: dict[str, int]) -> str:
    """The package or wing of `layers` that a module of relight is in; "" if it is in none."""
    parts = module.split(".")
    names = (".".join(parts[1:end]) for end in range(len(parts), 1, -1))
    return next((name for name in names if name in layers), "")


def test_packages_import_only_from_lower_layers():
    """Also inside functions. The layers are those of CONTRIBUTING.md, which has every package, or all of its wings."""
    listed = (ROOT.parent / "CONTRIBUTING.md").read_text().partition("* **Layers**")[2].split("```")[1]
    layers = {name: number for number, line in enumerate(listed.strip().splitlines()) for name in line.split()}
    paths = [path for path in ROOT.rglob("*.py") if path.parent != ROOT or path.stem != "__init__"]
    assert {name.partition(".")[0] for name in layers} == {
        path.relative_to(ROOT).with_suffix("").parts[0] for path in paths
    }
    upward = []
    for path in paths:
        module = ".".join(("relight", *path.relative_to(ROOT).with_suffix("").parts))
        own = layer_of(module, layers)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "relight":
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
                used = {layer_of(name, layers) for name in names} - {own, ""}
                assert own, f"{module} is in no layer"
                upward += [f"{module} imports {name}" for name in used if layers[name] >= layers[own]]
    assert not upward
