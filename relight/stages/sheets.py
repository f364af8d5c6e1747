"""Draws contact sheets of the figures and of the lights, and measures the self-occlusion of the figures."""

from pathlib import Path

from relight.stages.stage import stage

SHEET_FIGURES = 48  # of the contact sheet


@stage(
    "sheets",
    names="figures, one per line (.txt)",
    maps="folder of maps",
    lights="lights (.npz)",
    figures="contact sheet of the figures (.png)",
    spheres="contact sheet of the lights (.png)",
    occlusion="statistics of the figures (.csv)",
    histogram="chart of their occlusion (.png)",
)
def main(
    names: Path,
    maps: Path,
    lights: Path,
    figures: Path,
    spheres: Path,
    occlusion: Path,
    histogram: Path,
) -> None:
    """Draws figures and lights, and measures the self-occlusion of the figures."""
    from relight.evaluation.experiments.occlusion import measure_occlusion, plot_occlusion
    from relight.evaluation.pictures.contact import clearest_light, contact_sheet
    from relight.lights import read_light_set, write_contact_sheet

    paths = [maps / f"{name}.exr" for name in names.read_text().split()]
    plot_occlusion(measure_occlusion(paths, occlusion), histogram)
    light_set = read_light_set(lights)
    write_contact_sheet(light_set, spheres)
    contact_sheet(paths[:SHEET_FIGURES], clearest_light(light_set.of("test").coefficients), figures)


if __name__ == "__main__":
    main.cli()
