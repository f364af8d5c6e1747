from pathlib import Path

from relight.lab.job import job, map_files
from relight.lab.page import viewer

with job(snakemake):
    given, name = snakemake.input, snakemake.params.name
    networks = dict(zip(snakemake.params.labels, map(Path, given.networks)))
    maps = map_files(given.maps, snakemake.params.figures)
    viewer(name, networks, Path(given.packed), Path(given.split), maps, Path(given.lights), Path(snakemake.output[0]))
