from pathlib import Path

from relight.extensions import reads
from relight.lab.job import job
from relight.meshes.find import FOUND
from relight.meshes.scans import read_scan

with job(snakemake):
    name = snakemake.wildcards.batch
    read_scan(Path(snakemake.params.mesh), name, snakemake.params.subject, Path(snakemake.output[0], f"{name}.npz"))
    for path in FOUND - {Path(file).resolve() for file in snakemake.input}:  # what the plan did not take for the scan's
        reads(path)
