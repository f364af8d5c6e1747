from pathlib import Path

from relight.evaluation.report.results import Results
from relight.evaluation.report.sections import write_score_table
from relight.lab.job import job

with job(snakemake):
    folder, data = Path(snakemake.output[0]).parents[1], Path(snakemake.input.record).parent
    results = Results(folder, snakemake.params.experiments, data)
    for name in results.tables:
        write_score_table(results.table(name), results.title(name), results.report / name)
