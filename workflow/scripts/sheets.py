from pathlib import Path

from relight.evaluation.pictures.contact import clearest_light, contact_sheet, light_sheet
from relight.lab.job import job
from relight.lights import read_light_set

SHEET_FIGURES = 48  # of the contact sheet

with job(snakemake):
    maps, out = [Path(path) for path in snakemake.params.maps], snakemake.output
    lights = read_light_set(Path(snakemake.input.lights))
    light_sheet(lights, Path(out.lights))
    contact_sheet(maps[:SHEET_FIGURES], clearest_light(lights.of("test").coefficients), Path(out.figures))
