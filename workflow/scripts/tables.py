from pathlib import Path

from relight.evaluation.report.results import Results
from relight.evaluation.report.sections import write_score_table
from relight.lab.job import job

with job(snakemake):
    results = Results(Path(snakemake.output[0]).parents[1], snakemake.params.experiments)
    for name in results.tables:
        write_score_table(results.table(name), results.title(name), results.report / name)
