from pathlib import Path

from relight.lab.job import job
from relight.learning.split import write_split
from relight.settings import Split

with job(snakemake):
    settings = Split(**snakemake.params.split, least=snakemake.config["job"]["least"])
    write_split(settings, Path(snakemake.input.packed), Path(snakemake.input.record), Path(snakemake.output[0]))
