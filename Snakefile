# From meshes and panoramas to a finished report. Settings come from conf/ (Hydra); see docs/workflow.md.
#
# Accepted findings of `snakemake --lint`: rules have no conda environment or container, since one environment is locked
# for all stages (constraints.txt, environment.yml, Dockerfile). Rules in settings.smk have no log, since they write a few
# lines by `printf`. `rule` is defined by Snakemake in shell commands.
from snakemake.utils import min_version

min_version("9.0")


include: "workflow/rules/common.smk"
include: "workflow/rules/settings.smk"
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
