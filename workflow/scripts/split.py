from pathlib import Path

from relight.config import Split
from relight.lab.data import split
from relight.lab.job import job

with job(snakemake):
    settings = Split(**{**snakemake.params.split, "kind": snakemake.wildcards.kind})
    split(settings, Path(snakemake.input.packed), Path(snakemake.input.record), Path(snakemake.output[0]))
