"""Networks, losses, lights and figures of your own: a file each in this folder, which settings name by its stem.

A file defines what it offers, one or several of these:

network     a subclass of `relight.learning.networks.Network`; model.name=<stem>
loss        loss(outputs, batch) -> scalar Tensor, as in `relight.learning.losses`; +loss.extra.<stem>=<weight>
light       light(text, order) -> Light or coefficients (K,3); `<stem>:<text>` wherever a light is named
figure      figure(figures, seed) -> Mesh in meters; figures.source=<stem>
"""

from importlib import import_module
from pathlib import Path
from typing import Any

from relight.files import UserError


def names() -> tuple[str, ...]:
    """The stems of the files. None is imported: settings are checked where torch is not loaded."""
    files = (file for folder in __path__ for file in Path(folder).glob("*.py"))
    return tuple(sorted(file.stem for file in files if not file.stem.startswith("_")))


def extension(name: str, part: str) -> Any:
    """Imports a file of this folder.

    Args:
        name: its stem. Others are refused, since names come from files of weights, too.
        part: what it must define, such as "network".

    Returns:
        What it defines by that name.

    Raises:
        UserError: if there is no such file, or it does not define `part`.
    """
    if name not in names():
        raise UserError(f"{name}: there is no file {name}.py in relight/extensions")
    found = getattr(import_module(f"{__name__}.{name}"), part, None)
    if found is None:
        raise UserError(f"relight/extensions/{name}.py defines no `{part}`")
    return found
