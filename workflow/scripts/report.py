from pathlib import Path

from relight.evaluation.report.build import build_report
from relight.evaluation.report.results import Results
from relight.lab.job import job
from relight.lab.tracking.run import log_report

with job(snakemake):
    page, data = Path(snakemake.output[0]), Path(snakemake.input.record).parent
    build_report(Results(page.parents[1], snakemake.params.experiments, data), page)
    networks, tables = map(Path, snakemake.input.networks), map(Path, snakemake.input.tables)
    log_report(snakemake.config["job"]["tracking"], networks, [page, *tables], page.parents[1] / "run.yaml")
