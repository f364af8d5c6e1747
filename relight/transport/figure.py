"""Bakes the maps of a figure by the settings of the workflow."""

import sys
from itertools import chain
from pathlib import Path
from typing import Any

from relight.core.errors import UserError
from relight.maps import write_left_out, write_maps
from relight.meshes import Mesh
from relight.settings import Bake
from relight.transport.baker import Baker
from relight.transport.view import FRONTAL, outfit_names, random_view, view_names


def bake_figure(path: Path, settings: Bake, folder: Path) -> None:
    """Bakes the maps of all views and outfits of a figure, or leaves all of them out.

    Args:
        path: the aligned mesh record (.npz).
        settings: of the baker.
        folder: of the maps (.exr), which have the name of the figure with the endings of its outfits and views.
    """
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
            baker = Baker(aligned, settings)
            for view, view_targets in zip(views, targets):
                for (out, record), maps in zip(view_targets, baker.outfits(view)):
                    maps.info.update(record)
                    write_maps(out, maps)
        except UserError as error:
            reason = str(error)
            print(f"{name} is left out: {reason}", file=sys.stderr)
    if reason is not None:
        for out, record in chain.from_iterable(targets):
            write_left_out(out, {**aligned.info, **record}, reason)
