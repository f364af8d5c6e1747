"""Finds the files that a mesh names: textures, libraries of materials, buffers, scans of a table."""

import os
from pathlib import Path, PurePosixPath

from relight.core.errors import UserError
from relight.core.names import find_path, folded
from relight.core.text import spellings

SOUGHT: set[Path] = set()  # all files that `find_file` has found, and those beside the mesh that it would take first


def find_file(beside: Path, *names: str | bytes) -> Path:
    """Finds a file that another one names, in the same folder or a subfolder; never outside of it.

    The path as written is tried first, then the name alone in the folder, then in its subfolders. So backslashes, other
    capitals and folders of another computer do no harm. Bytes are read in each code page until one names a file.

    Args:
        beside: the .obj, .mtl, .ply or .gltf file that names it.
        *names: as written there, the likeliest first.

    Raises:
        UserError: if there is no such file, if several are found in subfolders, or if it is outside the folder.
    """
    folder = beside.parent.resolve()
    written = [text for name in names for text in (spellings(name) if isinstance(name, bytes) else [name])]
    if not (tried := [path for text in written if (path := PurePosixPath(text.replace("\\", "/"))).name]):
        raise UserError(f"{beside} names no file where it should name one")
    file = next((file for wanted in tried if (file := _find_beside(folder, wanted))), None)
    if (file := file or _find_below(beside, folder, tried)) is None:
        where = "there is no such file in the folder" if _is_inside(tried[0]) else "it lies outside the folder"
        raise UserError(f"{beside} names {written[0]}, but {where}; put it beside {beside.name}")
    try:
        real = file.resolve(strict=True)
    except (OSError, RuntimeError):
        raise UserError(f"{beside} names {written[0]}, which is a link that leads nowhere") from None
    if not real.is_relative_to(folder) or not real.is_file():
        raise UserError(f"{beside} names {written[0]}, which leads out of the folder or is no file; put one beside it")
    SOUGHT.add(real)
    return real


def _is_inside(path: PurePosixPath) -> bool:
    """Returns whether a path as written stays in the folder: it is relative, without `..` or the drive of Windows."""
    return not path.is_absolute() and ".." not in path.parts and ":" not in path.parts[0]


def _find_beside(folder: Path, wanted: PurePosixPath) -> Path | None:
    """Returns the file at the path `wanted` below a folder, or else the file of its name in the folder, or None."""
    places = [wanted.parts, wanted.parts[-1:]] if _is_inside(wanted) else [wanted.parts[-1:]]
    SOUGHT.update(folder.joinpath(*parts) for parts in places)
    return next(filter(None, (find_path(folder, parts) for parts in places)), None)


def _find_below(beside: Path, folder: Path, tried: list[PurePosixPath]) -> Path | None:
    """Returns the one file in the subfolders that has a name of `tried`, or None; UserError if there are several."""
    names = {folded(wanted.name) for wanted in tried}
    found = [Path(root, file) for root, _, files in os.walk(folder) for file in files if folded(file) in names]
    if len(found) > 1:
        raise UserError(f"{beside} names {tried[0]}, and {len(found)} files in the subfolders are called so")
    return found[0] if found else None
