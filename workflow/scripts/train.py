from pathlib import Path

from relight.lab.job import job
from relight.lab.training import train
from relight.learning.train import Inputs

with job(snakemake):
    given = snakemake.input
    inputs = Inputs(Path(given.packed), Path(given.lights), Path(given.split), snakemake.params.code)
    out, curve = Path(snakemake.output.network), Path(snakemake.output.curve)
    train(snakemake.params.settings, inputs, out, curve, snakemake.config["tracking"])
