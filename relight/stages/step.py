"""A step on one figure that leaves a broken figure out instead of ending the run."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from relight.files import UserError
from relight.meshes import Mesh


def step(make: Callable[[], Mesh], info: dict, out: Path) -> None:
    """Saves what `make` returns; when it raises UserError, saves an empty mesh whose info says why it is left out.

    The graph of jobs is known before they run, so each figure has its output at every stage: a figure that is left
    out is passed on, and the report lists it.
    """
    try:
        mesh = make()
    except UserError as error:
        print(f"{info.get('name', out.stem)} is left out: {error}", file=sys.stderr)
        mesh = left_out(info, str(error))
    mesh.save(out)


def onward(mesh: Path, change: Callable[[Mesh], Mesh], out: Path) -> None:
    """`step` from one record to the next; a figure that was left out before is passed on as it is."""
    given = Mesh.load(mesh)
    if "left_out" in given.info:
        given.save(out)
    else:
        step(lambda: change(given), given.info, out)


def left_out(info: dict, reason: str) -> Mesh:
    """A mesh without faces that carries the reason."""
    return Mesh(
        vertices=np.zeros((0, 3), np.float32),
        faces=np.zeros((0, 3), np.int32),
        uv=np.zeros((0, 3, 2), np.float32),
        material=np.zeros(0, np.int16),
        materials=[],
        info={**info, "left_out": reason},
    )
