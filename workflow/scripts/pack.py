from pathlib import Path

from relight.lab.job import job
from relight.maps import pack_figures

with job(snakemake):
    maps = [Path(path) for path in snakemake.params.maps]
    pack_figures(maps, snakemake.config["least"], Path(snakemake.output.packed), Path(snakemake.output.record))
