"""Entry points of a package that are imported when they are first used."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def entry_points(
    package: str, modules: dict[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Lets a package export names of its modules and stay as cheap to import as an empty one (PEP 562).

    No exported name may be the name of a module of the package: importing that module would hide the export.

    Args:
        package: `__name__` of the package.
        modules: the exported names of each module, separated by spaces, by the module's name within the package.

    Returns:
        The package's `__getattr__`, `__dir__` and `__all__`.
    """
    homes = {name: f"{package}.{module}" for module, names in modules.items() for name in names.split()}

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return get, lambda: sorted(homes), sorted(homes)
