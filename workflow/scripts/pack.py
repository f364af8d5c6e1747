from pathlib import Path

from relight.lab.job import job, map_files
from relight.maps import pack_figures

with job(snakemake):
    maps = map_files(snakemake.input, snakemake.params.names)
    pack_figures(maps, snakemake.config["job"]["least"], Path(snakemake.output.packed), Path(snakemake.output.record))
