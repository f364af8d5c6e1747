from pathlib import Path

from relight.evaluation.experiments.tracing import trace
from relight.lab.job import job
from relight.settings import Panoramas, Trace

with job(snakemake):
    given, settings = snakemake.input, snakemake.params
    meshes = {path.stem: path for folder in given.meshes for path in Path(folder).glob("*.npz")}
    trace(
        *(Path(given.packed), Path(given.lights), Path(given.split), meshes),
        *(Panoramas(**settings.panoramas), Trace(**settings.trace), settings.order, settings.rays),
        Path(snakemake.output[0]),
    )
