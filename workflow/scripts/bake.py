from pathlib import Path

from relight.core.progress import progress
from relight.lab.job import job
from relight.settings import Bake
from relight.transport.figure import bake_figure

with job(snakemake):
    settings = Bake(**snakemake.params.bake)
    for mesh in progress(sorted(Path(snakemake.input[0]).glob("*.npz")), "figures"):
        bake_figure(mesh, settings, Path(snakemake.output[0]))
