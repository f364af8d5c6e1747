"""Generates one figure from its seed."""

from pathlib import Path

from relight.config import Figures
from relight.errors import UserError
from relight.extensions import extension
from relight.meshes import Mesh
from relight.stages.stage import stage
from relight.stages.step import save_mesh


@stage("figure", figure="g and a seed, such as g0012", out="mesh record (.npz)")
def main(figures: Figures, figure: str, out: Path) -> None:
    """Writes the figure of a seed, or the record of a left-out figure."""
    from relight.figures.constraints import Constraints
    from relight.figures.dress import make_figure, subject_of

    if not (figure.startswith("g") and figure[1:].isdigit()):
        raise UserError(f"io.figure must be g and a seed, such as g0012, not {figure}")
    seed = int(figure[1:])

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
        mesh.info.update(name=figure, axes={"up": "+y", "front": "+z"})
        return mesh

    if_left_out = {
        "name": figure,
        "subject": subject_of(seed, figures.per_subject),
        "outfits": [None] * figures.outfits,
    }
    save_mesh(make, if_left_out, out)


if __name__ == "__main__":
    main.cli()
