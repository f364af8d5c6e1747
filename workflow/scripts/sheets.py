from pathlib import Path

from relight.evaluation.pictures.contact import clearest_light, contact_sheet, light_sheet
from relight.lab.job import job, map_files
from relight.lights import read_light_set

SHEET_FIGURES = 48  # of the contact sheet

with job(snakemake):
    maps, out = map_files(snakemake.input.maps, snakemake.params.figures), snakemake.output
    lights = read_light_set(Path(snakemake.input.lights))
    light_sheet(lights, Path(out.lights))
    contact_sheet(maps[:SHEET_FIGURES], clearest_light(lights.of("test").coefficients), Path(out.figures))
