"""Lazy imports of the entry points of a package."""

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def entry_points(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Returns what a package needs to export names of its modules and import them on first use (PEP 562).

    The exports are the imports in the package's stub, `__init__.pyi`, which type checkers read. An exported name must
    not be that of a module of the package, since importing the module would hide the export.

    Args:
        package: `__name__` of the package.
        file: its `__file__`.

    Returns:
        The package's `__getattr__`, `__dir__` and `__all__`.
    """
    stub = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    module_of = {alias.name: str(node.module) for node in imports for alias in node.names}

    def get(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(module_of[name]), name)

    return get, lambda: sorted(module_of), sorted(module_of)
