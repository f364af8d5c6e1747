import json
import os
import re
import shlex
import sys
from pathlib import Path

sys.path.insert(0, str(Path(workflow.basedir).parent))

from snakemake.exceptions import WorkflowError

from relight.files import UserError, is_unsafe_name
from relight.processes import STARTED_BY
from relight.scheduling import limit_scheduler_timers
from relight.tracking.workflow import WORKFLOW, finish_workflow
from relight.workflow import FAILED, Plan, report_others

limit_scheduler_timers()
os.environ[STARTED_BY] = str(os.getpid())

try:
    PLAN = Plan(config, json.loads(os.environ.get(FAILED, "{}")))
    PLAN.check()
except UserError as error:
    raise WorkflowError(str(error)) from None
OUT = PLAN.out
WORKFLOW_INFO = PLAN.workflow()
os.environ[WORKFLOW] = WORKFLOW_INFO.to_json()


onstart:
    PLAN.write_record(".")


onsuccess:
    PLAN.clean_up({str(path) for job in workflow.dag.jobs for path in job.output})
    finish_workflow(WORKFLOW_INFO, PLAN.networks, Path(OUT, "report"))


onerror:
    finish_workflow(WORKFLOW_INFO, PLAN.networks, Path(OUT, "report"), failed=True)
    # Not after Ctrl-C, which Snakemake tells nowhere else; and where everything was to be made.
    if not workflow.scheduler._user_kill and any(
        job.rule.name == "all" for job in workflow.dag.jobs
    ):
        report_others(PLAN)


wildcard_constraints:
    figure="|".join(map(re.escape, PLAN.single_figures)) or "(?!)",
    decade="|".join(PLAN.decades) or "(?!)",
    run="|".join(map(re.escape, PLAN.trainings)),
    experiment="|".join(map(re.escape, PLAN.experiments)),
    kind="subject|paper|disjoint|siblings",
    on="((test|sitting|views)-(test|unusual)/)?",


def settings(stage):
    return f"{OUT}/config/{stage}.yaml"


def command(stage):
    """The command of a stage; its words reach the console and the log."""
    return (
        f"{{{{ {shlex.quote(sys.executable)} -m relight.stages.{stage} "
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


def decade(folder):
    """The records of the figures of a decade in a folder, as patterns."""
    return [f"{OUT}/{folder}/{{decade}}{digit}.npz" for digit in range(10)]


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
    return f"{OUT}/split/{PLAN.settings(run)['split']['kind']}.json"


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


# The braces are a shell of its own, whose word about a command that the system killed is long and not needed (see the
# logger). A stage says first what it was called with (relight.stages.stage): lines with "# ", which are for the log alone.
LOGGED = " 2>&1; }} 2>/dev/null | tee {log:q} | sed -u '\\,^# ,d'"
LOGGED_RUN = LOGGED + """ | sed -u s,^,{rule:q}" "{wildcards.run:q}": ","""
