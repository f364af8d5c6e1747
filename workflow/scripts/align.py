from pathlib import Path

from relight.core.progress import progress
from relight.lab.job import job
from relight.meshes import align
from relight.meshes.left_out import transform
from relight.settings import Align

with job(snakemake):
    settings = Align(**snakemake.params.align)
    for mesh in progress(sorted(Path(snakemake.input[0]).glob("*.npz")), "figures"):
        transform(mesh, lambda given: align(given, settings), Path(snakemake.output[0], mesh.name))
