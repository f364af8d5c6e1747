from pathlib import Path

from relight.evaluation.experiments.transfer import evaluate_transfer, transfer_plate
from relight.lab.job import job

with job(snakemake):
    given, out = snakemake.input, snakemake.output
    networks = dict(zip(snakemake.params.trainings, map(Path, given.networks)))
    data = Path(given.packed), Path(given.lights), Path(given.split)
    evaluate_transfer(networks, *data, Path(out.scores))
    transfer_plate({row: networks[first] for row, first in snakemake.params.rows.items()}, *data, Path(out.plate))
