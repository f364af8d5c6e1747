from pathlib import Path

from relight.evaluation.scoring.baselines import evaluate_baselines
from relight.lab.job import job

with job(snakemake):
    packed, lights, split = map(Path, snakemake.input)
    condition = snakemake.wildcards.on.strip("/") or "test"
    given = snakemake.params
    evaluate_baselines(packed, lights, split, condition, Path(snakemake.output[0]), given.color, given.order)
