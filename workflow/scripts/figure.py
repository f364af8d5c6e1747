from pathlib import Path

from relight.core.progress import progress
from relight.figures.save import save_figure
from relight.lab.job import job
from relight.settings import Figures

with job(snakemake):
    settings = Figures(**snakemake.params.figures)
    for name in progress(snakemake.params.names, "figures"):
        save_figure(name, settings, Path(snakemake.output[0], f"{name}.npz"))
