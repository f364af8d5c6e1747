from pathlib import Path

from relight.evaluation.experiments.path_traced import evaluate_traced, traced_plate
from relight.lab.job import job

with job(snakemake):
    given, out = snakemake.input, snakemake.output
    networks = dict(zip(snakemake.params.trainings, map(Path, given.networks)))
    data = Path(given.packed), Path(given.lights), Path(given.traced)
    evaluate_traced(networks, *data, Path(out.scores))
    traced_plate({row: networks[first] for row, first in snakemake.params.rows.items()}, *data, Path(out.plate))
