from pathlib import Path

from relight.core.progress import progress
from relight.lab.job import job
from relight.meshes import align
from relight.meshes.left_out import transform
from relight.settings import Align

with job(snakemake) as kept:
    settings = Align(**snakemake.params.align)
    meshes = [mesh for mesh in sorted(Path(snakemake.input[0]).glob("*.npz")) if mesh.stem not in kept]
    for mesh in progress(meshes, "figures"):
        transform(mesh, lambda given: align(given, settings), Path(snakemake.output[0], mesh.name))
