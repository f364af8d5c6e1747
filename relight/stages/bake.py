"""Bakes the maps of one figure: the frontal view, and further views."""

import sys
from itertools import chain
from pathlib import Path

from relight.config import Bake
from relight.errors import UserError
from relight.meshes import Mesh
from relight.stages.stage import stage


@stage("bake", mesh="aligned mesh record (.npz)", out="maps (.exr); those of further views and outfits go beside them")
def main(bake: Bake, mesh: Path, out: Path) -> None:
    """Writes the maps of all views and outfits of a figure, or leaves all of them out."""
    from relight.maps import write_left_out, write_maps
    from relight.transport import FRONTAL, Baker, outfit_names, random_view, view_names

    aligned = Mesh.load(mesh)
    name, fabrics = aligned.info.get("name", out.stem), aligned.info.get("outfits", [None])
    identity = {"figure": name, "subject": aligned.info.get("subject", name)}
    # Names of maps are that of the figure with these endings; the frontal view of the first outfit has none.
    outfit_endings, view_endings = outfit_names("", len(fabrics)), ["", *view_names("", bake.views)]
    views = [FRONTAL, *(random_view(view) for view in view_names(name, bake.views))]

    def target(outfit: int, view_ending: str) -> tuple[Path, dict]:
        """Returns the file of the maps of an outfit in a view, and what their record has beside that of the mesh.

        Args:
            outfit: its number, from 0.
            view_ending: one of `view_endings`.
        """
        ending = outfit_endings[outfit] + view_ending
        dressed = {"outfit": outfit, "fabrics": fabrics[outfit]} if outfit else {}
        record = {**identity, "name": name + ending, **dressed} if ending else {}
        return out.with_name(out.stem + ending + out.suffix), record

    targets = [[target(outfit, ending) for outfit in range(len(fabrics))] for ending in view_endings]  # by view, outfit
    reason = aligned.info.get("left_out")
    if reason is None:
        try:
            baker = Baker(aligned, bake.rays, bake.order, bounces=bake.bounces)
            for view, view_targets in zip(views, targets):
                for (path, record), maps in zip(view_targets, baker.outfits(bake.size, bake.supersample, view)):
                    maps.info.update(record)
                    write_maps(path, maps)
        except UserError as error:
            reason = str(error)
            print(f"{name} is left out: {reason}", file=sys.stderr)
    if reason is not None:
        for path, record in chain.from_iterable(targets):
            write_left_out(path, {**aligned.info, **record}, reason)


if __name__ == "__main__":
    main.cli()
