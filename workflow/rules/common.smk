import os
import re
import shlex
import sys

sys.path.insert(0, workflow.basedir)

from snakemake.exceptions import WorkflowError

from relight.files import UserError, odd
from relight.processes import STARTED_BY
from relight.scheduling import calm
from relight.workflow import Plan

calm()
os.environ[STARTED_BY] = str(os.getpid())

try:
    PLAN = Plan(config)
    PLAN.look()
except UserError as error:
    raise WorkflowError(str(error)) from None
OUT = PLAN.out


onstart:
    PLAN.record(".")


onsuccess:
    PLAN.settle({str(path) for job in workflow.dag.jobs for path in job.output})


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
        "printf %s {params.text:q} > {output:q}"


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
        "printf %s {params.figures:q} > {output.figures:q}; printf %s {params.maps:q} > {output.maps:q}"


# What the report is to answer.
rule experiments:
    output:
        f"{OUT}/config/experiments.json",
    localrule: True
    params:
        text=lambda wildcards: PLAN.questions(),
    shell:
        "printf %s {params.text:q} > {output:q}"


def settings(stage):
    return f"{OUT}/config/{stage}.yaml"


def command(stage):
    """The command of a stage; its words reach the console and the log."""
    return (
        f"{shlex.quote(sys.executable)} -m relight.stages.{stage} "
        f'--config-dir {OUT}/config --config-name "$(basename {{input.cfg:q}} .yaml)" '
    )


def named(port, field):
    """A word `port=name`, quoted for the shell and for Hydra, which takes null, true and 1e5 for values."""
    return f'{port}="\'"{{{field}:q}}"\'" '


def files(paths):
    """The user's files as inputs, without those whose names Snakemake would read as patterns; their stage says so."""
    return [str(path) for path in paths if not odd(path)]


LOGGED = " 2>&1 | tee {log:q}"
LOGGED_RUN = LOGGED + """ | sed -u s/^/{rule:q}" "{wildcards.run:q}": "/"""
