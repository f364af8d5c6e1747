from pathlib import Path

from relight.core.progress import progress
from relight.lab.figures import bake
from relight.lab.job import job
from relight.settings import Bake

with job(snakemake):
    settings = Bake(**snakemake.params.bake)
    for mesh in progress(sorted(Path(snakemake.input[0]).glob("*.npz")), "figures"):
        bake(mesh, settings, Path(snakemake.output[0]))
