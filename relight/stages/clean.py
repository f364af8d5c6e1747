"""Repairs the mesh of one figure, and records the repairs."""

from pathlib import Path

from relight.config import Clean
from relight.stages.stage import stage
from relight.stages.step import transform_mesh


@stage("clean", mesh="mesh record (.npz)", out="mesh record (.npz)")
def main(clean: Clean, mesh: Path, out: Path) -> None:
    """Writes the mesh of a figure, repaired by `relight.meshes.cleaning.clean`; a left-out figure is copied."""
    from relight.meshes import clean as clean_mesh

    transform_mesh(mesh, lambda given: clean_mesh(given, clean), out)


if __name__ == "__main__":
    main.cli()
