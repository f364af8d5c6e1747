from pathlib import Path

from relight.core.progress import progress
from relight.figures.make import save_figure
from relight.lab.job import job
from relight.settings import Figures

with job(snakemake) as kept:
    settings = Figures(**snakemake.params.figures)
    for name in progress([name for name in snakemake.params.names if name not in kept], "figures"):
        save_figure(name, settings, Path(snakemake.output[0], f"{name}.npz"))
