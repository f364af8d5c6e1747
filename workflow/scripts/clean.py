from pathlib import Path

from relight.core.progress import progress
from relight.lab.job import job
from relight.meshes import clean
from relight.meshes.left_out import transform

with job(snakemake):
    for mesh in progress(sorted(Path(snakemake.input[0]).glob("*.npz")), "figures"):
        transform(mesh, clean, Path(snakemake.output[0], mesh.name))
