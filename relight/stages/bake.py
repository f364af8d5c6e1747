"""Bakes the maps of one figure: the frontal view, and as many others as are asked for."""

import sys
from pathlib import Path

from relight.config import Bake
from relight.files import UserError
from relight.meshes import Mesh
from relight.stages.stage import stage


@stage("bake", mesh="aligned mesh record (.npz)", out="maps (.exr); those of further views go beside them")
def main(bake: Bake, mesh: Path, out: Path) -> None:
    """A figure is left out with all its views, so that a data set holds either all of its maps or none."""
    from relight.maps import write_left_out, write_maps
    from relight.transport import FRONTAL, Baker, random_view, view_names

    given = Mesh.load(mesh)
    name = given.info.get("name", out.stem)
    own = {"figure": name, "subject": given.info.get("subject", name)}
    targets = {out: ({}, FRONTAL)}
    for view, file in zip(view_names(name, bake.views), view_names(out.stem, bake.views)):
        targets[out.with_name(file + out.suffix)] = ({**own, "name": view}, random_view(view, bake.seed))
    reason = given.info.get("left_out")
    if reason is None:
        try:
            baker = Baker(given, bake.rays, bake.order, bake.seed, bake.bounces)
            for path, (record, view) in targets.items():
                maps = baker.maps(bake.size, bake.supersample, view)
                maps.info.update(record)
                write_maps(path, maps)
        except UserError as error:
            reason = str(error)
            print(f"{name} is left out: {reason}", file=sys.stderr)
    if reason is not None:
        for path, (record, _) in targets.items():
            write_left_out(path, {**given.info, **record}, reason)


if __name__ == "__main__":
    main.cli()
