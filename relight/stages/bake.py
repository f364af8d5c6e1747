"""Bakes the maps of one figure: the frontal view, and further views."""

import sys
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
    views = [FRONTAL, *(random_view(view) for view in view_names(name, bake.views))]
    targets: list[list[tuple[Path, dict]]] = [[] for _ in views]  # of each view, the outfits
    for number, label in enumerate(outfit_names("", len(fabrics))):
        outfit = {"outfit": number, "fabrics": fabrics[number]} if number else {}
        for k, ending in enumerate(["", *view_names("", bake.views)]):
            record = {**identity, "name": name + label + ending, **outfit} if label + ending else {}
            targets[k].append((out.with_name(out.stem + label + ending + out.suffix), record))
    reason = aligned.info.get("left_out")
    if reason is None:
        try:
            baker = Baker(aligned, bake.rays, bake.order, bounces=bake.bounces)
            for view, files in zip(views, targets):
                for (path, record), maps in zip(files, baker.outfits(bake.size, bake.supersample, view)):
                    maps.info.update(record)
                    write_maps(path, maps)
        except UserError as error:
            reason = str(error)
            print(f"{name} is left out: {reason}", file=sys.stderr)
    if reason is not None:
        for path, record in (target for files in targets for target in files):
            write_left_out(path, {**aligned.info, **record}, reason)


if __name__ == "__main__":
    main.cli()
