"""Aligns one figure with the camera: up, front, centre and size."""

from pathlib import Path

from relight.config import Align
from relight.stages.stage import stage
from relight.stages.step import transform_mesh


@stage("align", mesh="mesh record (.npz)", out="mesh record (.npz)")
def main(align: Align, mesh: Path, out: Path) -> None:
    """Writes the mesh of a figure, aligned by `relight.meshes.alignment.align`; a left-out figure is copied."""
    from relight.meshes import align as align_mesh

    transform_mesh(mesh, lambda given: align_mesh(given, align), out)


if __name__ == "__main__":
    main.cli()
