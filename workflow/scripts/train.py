from pathlib import Path

from relight.lab.job import job
from relight.lab.training import train
from relight.learning.train import Inputs

with job(snakemake):
    given, settings = snakemake.input, snakemake.params.settings
    settings["train"] |= {"device": snakemake.resources.device, "start": str(given.start) or None}
    inputs = Inputs(Path(given.packed), Path(given.lights), Path(given.split))
    out, curve = Path(snakemake.output.network), Path(snakemake.output.curve)
    train(settings, inputs, out, curve, snakemake.config["job"]["tracking"])
