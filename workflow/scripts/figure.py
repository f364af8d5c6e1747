from pathlib import Path

from relight.config import Figures
from relight.lab.figures import draw
from relight.lab.job import job
from relight.progress import progress

with job(snakemake):
    settings = Figures(**snakemake.params.figures)
    for name in progress(snakemake.params.names, "figures"):
        draw(name, settings, Path(snakemake.output[0], f"{name}.npz"))
