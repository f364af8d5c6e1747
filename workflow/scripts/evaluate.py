from pathlib import Path

from relight.lab.job import job
from relight.lab.training import evaluate

with job(snakemake):
    network, packed, lights, split = map(Path, snakemake.input)
    condition = snakemake.wildcards.on.strip("/") or "test"
    evaluate(network, packed, lights, split, condition, Path(snakemake.output[0]), snakemake.config["job"]["tracking"])
