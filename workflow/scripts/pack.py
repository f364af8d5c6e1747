from pathlib import Path

from relight.lab.data import pack
from relight.lab.job import job

with job(snakemake):
    maps = [Path(path) for path in snakemake.params.maps]
    pack(maps, snakemake.params.least, Path(snakemake.output.packed), Path(snakemake.output.record))
