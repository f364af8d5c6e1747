import re
import shlex
import sys

sys.path.insert(0, workflow.basedir)

from snakemake.exceptions import WorkflowError

from relight.files import UserError
from relight.scheduling import calm
from relight.workflow import Plan

calm()

try:
    PLAN = Plan(config)
    PLAN.look()
except UserError as error:
    raise WorkflowError(str(error)) from None
OUT = PLAN.out


wildcard_constraints:
    figure="|".join(map(re.escape, PLAN.figures)),
    run="|".join(map(re.escape, PLAN.runs)),
    experiment="|".join(map(re.escape, PLAN.experiments)),
    kind="subject|paper|disjoint|siblings",
    on="((test|sitting|views)-(test|unusual)/)?",


# The settings of every stage are a file in the graph, so that a change re-runs what reads them, and what follows.
rule settings:
    output:
        f"{OUT}/config/{{stage}}.yaml",
    localrule: True
    params:
        text=lambda wildcards: PLAN.settings(wildcards.stage),
    shell:
        "printf %s {params.text:q} > {output}"


MAPS = [name for figure in PLAN.figures for name in PLAN.maps(figure)]


# The figures of this plan, and the maps of all their views, one per line.
rule listing:
    output:
        figures=f"{OUT}/config/figures.txt",
        maps=f"{OUT}/config/maps.txt",
    localrule: True
    params:
        figures="".join(f"{figure}\n" for figure in PLAN.figures),
        maps="".join(f"{name}\n" for name in MAPS),
    shell:
        "printf %s {params.figures:q} > {output.figures}; printf %s {params.maps:q} > {output.maps}"


# What the report is to answer.
rule experiments:
    output:
        f"{OUT}/config/experiments.json",
    localrule: True
    params:
        text=lambda wildcards: PLAN.asked(),
    shell:
        "printf %s {params.text:q} > {output}"


def settings(stage):
    return f"{OUT}/config/{stage}.yaml"


def command(stage):
    """The command of a stage; its words reach the console and the log."""
    return (
        f"{shlex.quote(sys.executable)} -m relight.stages.{stage} "
        f"--config-dir {OUT}/config --config-name $(basename {{input.cfg}} .yaml) "
    )


LOGGED = " 2>&1 | tee {log}"
LOGGED_RUN = LOGGED + " | sed -u 's/^/{rule} {wildcards.run}: /'"
