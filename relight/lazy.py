"""Entry points of a package that are imported when they are first used."""

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def entry_points(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Lets a package export names of its modules and stay as cheap to import as an empty one (PEP 562).

    The exports are the imports of the package's stub, `__init__.pyi`, from which type checkers know their types. No
    exported name may be the name of a module of the package: importing that module would hide the export.

    Args:
        package: `__name__` of the package.
        file: its `__file__`.

    Returns:
        The package's `__getattr__`, `__dir__` and `__all__`.
    """
    stub = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    homes = {alias.name: str(one.module) for one in stub.body if isinstance(one, ast.ImportFrom) for alias in one.names}

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return get, lambda: sorted(homes), sorted(homes)
