from pathlib import Path

from relight.lab.job import job
from relight.meshes.scans import read_scan

with job(snakemake):
    name = snakemake.wildcards.batch
    read_scan(Path(snakemake.params.mesh), name, snakemake.params.subject, Path(snakemake.output[0], f"{name}.npz"))
