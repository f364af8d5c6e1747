from pathlib import Path

from relight.evaluation.report.build import build_report
from relight.evaluation.report.results import Results
from relight.evaluation.report.sections import write_score_table
from relight.lab.job import job
from relight.lab.tracking.run import log_report

with job(snakemake):
    page, data = Path(snakemake.output.page), Path(snakemake.input.record).parent
    results = Results(page.parents[1], snakemake.params.experiments, data)
    for name in results.tables:
        write_score_table(results.table(name), results.title(name), results.report / name)
    build_report(results, page)
    networks, tables = map(Path, snakemake.input.networks), map(Path, snakemake.output.tables[::2])
    log_report(snakemake.config["job"]["tracking"], networks, [page, *tables], page.parents[1] / "run.yaml")
