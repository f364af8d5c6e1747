from pathlib import Path

from relight.core.progress import progress
from relight.figures.draw import draw
from relight.lab.job import job
from relight.settings import Figures

with job(snakemake):
    settings = Figures(**snakemake.params.figures)
    for name in progress(snakemake.params.names, "figures"):
        draw(name, settings, Path(snakemake.output[0], f"{name}.npz"))
