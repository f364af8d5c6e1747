"""The jobs of one figure: drawn or read, cleaned, aligned and baked, or left out with the reason.

The graph of jobs is fixed before they run, so every figure has an output at every step. A figure that cannot be
processed does not end the workflow; the report lists those that are left out.
"""

import sys
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import require_safe_name
from relight.extensions import extension
from relight.meshes import Mesh
from relight.settings import Bake, Figures


def draw(name: str, figures: Figures, out: Path) -> None:
    """Draws the figure of a seed.

    Args:
        name: g and the seed, such as g0012.
        figures: settings.
        out: the mesh record (.npz).
    """
    from relight.figures.constraints import Constraints
    from relight.figures.dress import make_figure, subject_of

    seed = int(name[1:])

    def make() -> Mesh:
        if figures.source == "generated":
            constraints = Constraints(
                figures.sitting, tuple(figures.poses), tuple(figures.garments), tuple(figures.hair)
            )
            mesh = make_figure(
                seed,
                detail=figures.detail,
                texture=figures.texture,
                per_subject=figures.per_subject,
                shading=figures.shading,
                outfits=figures.outfits,
                constraints=constraints,
            )
        else:
            mesh = extension(figures.source, "figure")(figures, seed)
        mesh.info.update(name=name, axes={"up": "+y", "front": "+z"})
        return mesh

    subject = subject_of(seed, figures.per_subject)
    save_mesh(make, {"name": name, "subject": subject, "outfits": [None] * figures.outfits}, out)


def read_scan(path: Path, name: str, subject: str, out: Path) -> None:
    """Reads the mesh of a scan without changes.

    Args:
        path: the mesh.
        name: of the figure.
        subject: name of the person.
        out: the mesh record (.npz).
    """
    from relight.meshes import read_mesh

    def make() -> Mesh:
        require_safe_name(path)
        mesh = read_mesh(path)
        mesh.info.update(name=name, subject=subject)
        return mesh

    save_mesh(make, {"name": name, "subject": subject}, out)


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


def bake(path: Path, settings: Bake, folder: Path) -> None:
    """Bakes the maps of all views and outfits of a figure, or leaves all of them out.

    Args:
        path: the aligned mesh record (.npz).
        settings: of the baker.
        folder: of the maps (.exr), which have the name of the figure with the endings of its outfits and views.
    """
    from relight.maps import write_left_out, write_maps
    from relight.transport import FRONTAL, Baker, outfit_names, random_view, view_names

    aligned = Mesh.load(path)
    name, fabrics = aligned.info.get("name", path.stem), aligned.info.get("outfits", [None])
    identity = {"figure": name, "subject": aligned.info.get("subject", name)}
    # The frontal view of the first outfit has no ending.
    outfit_endings, view_endings = outfit_names("", len(fabrics)), ["", *view_names("", settings.views)]
    views = [FRONTAL, *(random_view(view) for view in view_names(name, settings.views))]

    def target(outfit: int, view_ending: str) -> tuple[Path, dict[str, Any]]:
        """Returns the file of the maps of an outfit, by number, in a view, and their record beside that of the mesh."""
        ending = outfit_endings[outfit] + view_ending
        dressed = {"outfit": outfit, "fabrics": fabrics[outfit]} if outfit else {}
        return folder / f"{name}{ending}.exr", {**identity, "name": name + ending, **dressed} if ending else {}

    targets = [[target(outfit, ending) for outfit in range(len(fabrics))] for ending in view_endings]  # by view, outfit
    reason = aligned.info.get("left_out")
    if reason is None:
        try:
            baker = Baker(aligned, settings.rays, settings.order, bounces=settings.bounces)
            for view, view_targets in zip(views, targets):
                outfits = baker.outfits(settings.size, settings.supersample, view)
                for (out, record), maps in zip(view_targets, outfits):
                    maps.info.update(record)
                    write_maps(out, maps)
        except UserError as error:
            reason = str(error)
            print(f"{name} is left out: {reason}", file=sys.stderr)
    if reason is not None:
        for out, record in chain.from_iterable(targets):
            write_left_out(out, {**aligned.info, **record}, reason)


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
    return Mesh(
        vertices=np.zeros((0, 3), np.float32),
        faces=np.zeros((0, 3), np.int32),
        uv=np.zeros((0, 3, 2), np.float32),
        material=np.zeros(0, np.int16),
        materials=[],
        info={**info, "left_out": reason},
    )
