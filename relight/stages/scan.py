"""Reads one of the user's meshes."""

from pathlib import Path

from relight.config import Figures
from relight.errors import UserError
from relight.files import require_safe_name
from relight.meshes import Mesh
from relight.stages.stage import stage
from relight.stages.step import save_mesh


@stage("scan", figure="name of the figure in the folder", out="mesh record (.npz)")
def main(figures: Figures, figure: str, out: Path) -> None:
    """Writes the mesh of a scan without changes, or the record of a left-out figure."""
    from relight.meshes import list_scans, read_mesh

    if figures.folder is None:
        raise UserError("figures.folder=<the folder of the scans> is missing")
    scans = list_scans(figures.folder)
    if figure not in scans:
        raise UserError(f"io.figure: {figures.folder} has no scan {figure}; it has {', '.join(scans)}")

    def make() -> Mesh:
        require_safe_name(scans[figure].path)
        mesh = read_mesh(scans[figure].path)
        mesh.info.update(name=figure, subject=scans[figure].subject)
        return mesh

    save_mesh(make, {"name": figure, "subject": scans[figure].subject}, out)


if __name__ == "__main__":
    main.cli()
