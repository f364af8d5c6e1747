from pathlib import Path

from relight.extensions import reads
from relight.lab.job import job
from relight.meshes.find import SOUGHT
from relight.meshes.scans import read_scan

with job(snakemake):
    name = snakemake.wildcards.batch
    read_scan(Path(snakemake.params.mesh), name, snakemake.params.subject, Path(snakemake.output[0], f"{name}.npz"))
    for path in SOUGHT:  # its textures and libraries
        reads(path)
