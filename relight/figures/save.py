"""Makes the figure of a seed by the settings of the workflow, and saves its mesh record."""

from pathlib import Path

from relight.extensions import extension
from relight.figures.draw.constraints import Constraints
from relight.figures.make import make_figure, subject_of
from relight.meshes import Mesh
from relight.meshes.left_out import save_mesh
from relight.settings import Figures


def save_figure(name: str, figures: Figures, out: Path) -> None:
    """Makes the figure of a seed and saves it.

    Args:
        name: g and the seed, such as g0012.
        figures: settings.
        out: the mesh record (.npz).
    """
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
                outfits=figures.outfits,
                constraints=constraints,
            )
        else:
            mesh = extension(figures.source, "figure")(figures, seed)
        mesh.info.update(name=name, axes={"up": "+y", "front": "+z"})
        mesh.info.setdefault("subject", subject)
        return mesh

    subject = subject_of(seed, figures.per_subject)
    save_mesh(make, {"name": name, "subject": subject, "outfits": [None] * figures.outfits}, out)
