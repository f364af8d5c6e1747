"""Figures that a step of the workflow cannot process: they are left out, with the reason in their record.

The graph of jobs is fixed before they run, so every figure has an output at every step. A figure that cannot be
processed does not end the workflow; the report lists those that are left out.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.meshes.mesh import Mesh


def transform(path: Path, change: Callable[[Mesh], Mesh], out: Path) -> None:
    """Saves the changed mesh of a record; a left-out figure is copied.

    Args:
        path: the mesh record (.npz).
        change: changes the mesh; if it raises UserError, the figure is left out.
        out: the mesh record to write.
    """
    mesh = Mesh.load(path)
    if "left_out" in mesh.info:
        mesh.save(out)
    else:
        save_mesh(lambda: change(mesh), mesh.info, out)


def save_mesh(make: Callable[[], Mesh], info: dict[str, Any], out: Path) -> None:
    """Saves the mesh that `make` returns, or the record of a left-out figure if `make` raises UserError.

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


def left_out(info: dict[str, Any], reason: str) -> Mesh:
    """Returns a mesh without faces whose record has the reason in `left_out`."""
    vertices, faces = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
    uv, material = np.zeros((0, 3, 2), np.float32), np.zeros(0, np.int16)
    return Mesh(vertices, faces, uv, material, materials=[], info={**info, "left_out": reason})
