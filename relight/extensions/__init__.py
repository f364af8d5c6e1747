"""Networks, losses, lights and figures of users: a file in this folder, or a module of an installed package.

Settings refer to a file by its stem, and to a module by the name of its entry point in the group `relight.extensions`.
It defines what it offers, one or several of these:

network     a subclass of `relight.learning.networks.Network`; model.name=<name>
loss        loss(outputs, batch) -> scalar Tensor, as in `relight.learning.losses`; +loss.extra.<name>=<weight>
light       light(text, order) -> Light or coefficients (K,3); `<name>:<text>` wherever a light is named
figure      figure(figures, seed) -> Mesh in meters; figures.source=<name>

A file on which these depend is read as `reads(path)`, so that the workflow knows of it.
"""

import os
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from relight.core.errors import UserError

GROUP = "relight.extensions"
READ: set[str] = set()  # the files of `reads`; those below the working directory are relative to it


@cache
def installed() -> dict[str, str]:
    """Returns the modules of installed packages by the names of their entry points; none is imported."""
    return {point.name: point.value for point in entry_points(group=GROUP)}


def names() -> tuple[str, ...]:
    """Returns the names of all extensions. None is imported: settings are checked where torch is not loaded."""
    files = (file.stem for folder in __path__ for file in Path(folder).glob("*.py"))
    return tuple(sorted({*installed(), *(stem for stem in files if not stem.startswith("_"))}))


def reads(path: Path | str) -> Path | str:
    """Returns the path of a file, and has the workflow make again what was made with it when its content changes."""
    whole = os.path.abspath(path)
    READ.add(os.path.relpath(whole) if Path(whole).is_relative_to(Path.cwd()) else whole)
    return path


def missing(name: str) -> str:
    """Returns the message that there is no extension of a name."""
    return (
        f"{name}: there is no file {name}.py in relight/extensions, and no installed package has an entry point {name}"
    )


def extension(name: str, part: str) -> Any:
    """Imports an extension.

    Args:
        name: its name. Others are refused, since names come from files of weights, too.
        part: what it must define, such as "network".

    Returns:
        What it defines by that name.

    Raises:
        UserError: if there is no such extension, it cannot be imported, or it does not define `part`.
    """
    if name not in names():
        raise UserError(missing(name))
    module = installed().get(name, f"{__name__}.{name}")
    try:
        imported = import_module(module)
    except (SyntaxError, ImportError) as error:
        raise UserError(f"the extension {name} cannot be imported: {error}") from error
    if (defined := getattr(imported, part, None)) is None:
        raise UserError(f"the extension {module} defines no `{part}`")
    return defined
