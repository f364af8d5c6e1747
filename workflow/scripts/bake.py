from pathlib import Path

from relight.config import Bake
from relight.lab.figures import bake
from relight.lab.job import job
from relight.progress import progress

with job(snakemake):
    settings = Bake(**snakemake.params.bake)
    for mesh in progress(sorted(Path(snakemake.input[0]).glob("*.npz")), "figures"):
        bake(mesh, settings, Path(snakemake.output[0]))
