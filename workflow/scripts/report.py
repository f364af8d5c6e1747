from pathlib import Path

from relight.evaluation.report.build import build_report
from relight.lab.job import job

with job(snakemake):
    page = Path(snakemake.output.page)
    folder = page.parents[1]
    build_report(folder.name, snakemake.params.experiments, folder, page)
