"""Processes one figure; a figure that cannot be processed is left out, and does not end the workflow."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from relight.errors import UserError
from relight.meshes import Mesh


def save_mesh(make: Callable[[], Mesh], info: dict, out: Path) -> None:
    """Saves the mesh that `make` returns, or the record of a left-out figure if `make` raises UserError.

    The graph of jobs is fixed before they run, so every figure has an output at every stage. The report lists the
    figures that are left out.

    Args:
        make: makes the mesh.
        info: the record of the figure if it is left out, to which the reason is added.
        out: the mesh record (.npz).
    """
    try:
        mesh = make()
    except UserError as error:
        print(f"{info.get('name', out.stem)} is left out: {error}", file=sys.stderr)
        mesh = left_out(info, str(error))
    mesh.save(out)


def transform_mesh(path: Path, transform: Callable[[Mesh], Mesh], out: Path) -> None:
    """Saves the transformed mesh of a record; a left-out figure is copied.

    Args:
        path: the mesh record (.npz).
        transform: changes the mesh; if it raises UserError, the figure is left out.
        out: the mesh record to write.
    """
    mesh = Mesh.load(path)
    if "left_out" in mesh.info:
        mesh.save(out)
    else:
        save_mesh(lambda: transform(mesh), mesh.info, out)


def left_out(info: dict, reason: str) -> Mesh:
    """Returns a mesh without faces whose record has the reason in `left_out`."""
    return Mesh(
        vertices=np.zeros((0, 3), np.float32),
        faces=np.zeros((0, 3), np.int32),
        uv=np.zeros((0, 3, 2), np.float32),
        material=np.zeros(0, np.int16),
        materials=[],
        info={**info, "left_out": reason},
    )
