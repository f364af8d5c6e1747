# From meshes and panoramas to a finished report. Settings come from conf/ (Hydra); see docs/workflow.md.
from snakemake.utils import min_version

min_version("9.0")


include: "workflow/rules/common.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/lights.smk"
include: "workflow/rules/learning.smk"
include: "workflow/rules/experiments.smk"
include: "workflow/rules/report.smk"


rule all:
    default_target: True
    input:
        f"{OUT}/report/report.html",
        f"{OUT}/report/viewer.html",
        expand(f"{OUT}/report/{{table}}.csv", table=PLAN.tables),
