import os
import re
import shlex
import sys
from pathlib import Path

sys.path.insert(0, str(Path(workflow.basedir).parent))

from snakemake.exceptions import WorkflowError

from relight.files import UserError, is_unsafe_name
from relight.processes import STARTED_BY
from relight.scheduling import calm
from relight.track import WORKFLOW, conclude
from relight.workflow import Plan

calm()
os.environ[STARTED_BY] = str(os.getpid())

try:
    PLAN = Plan(config)
    PLAN.look()
except UserError as error:
    raise WorkflowError(str(error)) from None
OUT = PLAN.out
FLOW = PLAN.tracked()
os.environ[WORKFLOW] = FLOW.dumps()


onstart:
    PLAN.record(".")


onsuccess:
    PLAN.settle({str(path) for job in workflow.dag.jobs for path in job.output})
    conclude(FLOW, PLAN.networks, Path(OUT, "report"))


onerror:
    conclude(FLOW, PLAN.networks, Path(OUT, "report"), failed=True)


wildcard_constraints:
    figure="|".join(map(re.escape, PLAN.alone)) or "(?!)",
    tens="|".join(PLAN.tens) or "(?!)",
    run="|".join(map(re.escape, PLAN.runs)),
    experiment="|".join(map(re.escape, PLAN.experiments)),
    kind="subject|paper|disjoint|siblings",
    on="((test|sitting|views)-(test|unusual)/)?",


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
    return [str(path) for path in paths if not is_unsafe_name(path)]


def several(port, words):
    """A word `port=[path,...]` for Hydra. Generated names need no quotes; scans, whose may, come one by one."""
    if PLAN.scans:
        return f"{port}={words} "
    return f'{port}="[$(echo {words} | tr " " ,)]" '


def ten(folder):
    """The records of the figures of a decade in a folder, as patterns."""
    return [f"{OUT}/{folder}/{{tens}}{digit}.npz" for digit in range(10)]


def maps_of(names):
    """The maps of figures, from the front and from other sides, as patterns."""
    views = [view for name in names for view in PLAN.maps(name)[1:]]
    found = {"frontal": names, "views": views}
    return {
        kind: [ensure(f"{OUT}/maps/{name}.exr", non_empty=True) for name in paths]
        for kind, paths in found.items()
    }


def split_of(run):
    """The split that a run is trained and scored on."""
    return f"{OUT}/split/{PLAN.of_run(run).split.kind}.json"


def condition(on):
    """Overrides for the figures and lights that a folder of scores is about: "" or "sitting-test"."""
    figures, lights = Path(on).name.split("-") if on else ("test", "test")
    return f"evaluate.figures={figures} evaluate.lights={lights}"


def networks_of(experiment):
    """All trainings of an experiment's rows."""
    if experiment not in PLAN.experiments:
        return []
    rows = PLAN.experiments[experiment].rows
    return [PLAN.network(run) for row in rows for run in PLAN.of_row(row)]


def own_results(experiment):
    """What the report needs of an experiment that has stages of its own."""
    if experiment == "light_transfer":
        return rules.light_transfer.output
    if experiment == "path_traced":
        return rules.path_traced.output
    rows = PLAN.experiments[experiment].rows
    return [f"{OUT}/inference_time/{PLAN.of_row(row)[0]}.csv" for row in rows]


# A stage says first what it was called with (relight.stages.stage): lines with "# ", which are for the log alone.
LOGGED = " 2>&1 | tee {log:q} | sed -u '\\,^# ,d'"
LOGGED_RUN = LOGGED + """ | sed -u s,^,{rule:q}" "{wildcards.run:q}": ","""
