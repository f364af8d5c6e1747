from pathlib import Path

from relight.core.progress import progress
from relight.lab.job import job
from relight.settings import Bake
from relight.transport.figure import bake_figure

with job(snakemake) as kept:
    settings = Bake(**snakemake.params.bake)
    meshes = [mesh for mesh in sorted(Path(snakemake.input[0]).glob("*.npz")) if mesh.stem not in kept]
    for mesh in progress(meshes, "figures"):
        bake_figure(mesh, settings, Path(snakemake.output[0]))
