"""Bakes the maps of one figure."""

import sys
from pathlib import Path

from relight.config import Bake
from relight.files import UserError
from relight.meshes.mesh import Mesh
from relight.stages.stage import stage


@stage("bake", mesh="aligned mesh record (.npz)", out="maps (.exr)")
def main(bake: Bake, mesh: Path, out: Path) -> None:
    from relight.maps.exr import write_left_out, write_maps
    from relight.transport import bake as transport

    given = Mesh.load(mesh)
    reason = given.info.get("left_out")
    if reason is None:
        try:
            maps = transport.bake(
                given, bake.size, bake.rays, bake.order, bake.seed, supersample=bake.supersample, bounces=bake.bounces
            )
        except UserError as error:
            reason = str(error)
            print(f"{given.info.get('name', mesh.stem)} is left out: {reason}", file=sys.stderr)
    if reason is None:
        write_maps(out, maps)
    else:
        write_left_out(out, given.info, reason)


if __name__ == "__main__":
    main.cli()
