import json
import os
import re
import shlex
import sys
from pathlib import Path

sys.path.insert(0, str(Path(workflow.current_basedir).parents[1]))

from snakemake.exceptions import WorkflowError

from relight.code import save_cache
from relight.config_folder import ConfigFolder
from relight.errors import UserError
from relight.files import is_unsafe_name
from relight.processes import STARTED_BY
from relight.scheduling import limit_scheduler_timers
from relight.tracking.run import WORKFLOW
from relight.plan import FAILED_VARIABLE, Plan, report_completed

limit_scheduler_timers()
os.environ[STARTED_BY] = str(os.getpid())

try:
    PLAN = Plan(config, json.loads(os.environ.get(FAILED_VARIABLE, "{}")))
    PLAN.check()
except UserError as error:
    raise WorkflowError(str(error)) from None
OUT = PLAN.out
CONFIG = ConfigFolder(PLAN)
os.environ[WORKFLOW] = json.dumps(PLAN.tracking())


onstart:
    PLAN.write_record(".")
    save_cache()


onsuccess:
    PLAN.clean_up({str(path) for job in workflow.dag.jobs for path in job.output})


onerror:
    # Not after Ctrl-C, which only this attribute shows, and only if the whole workflow was requested.
    if not workflow.scheduler._user_kill and any(
        job.rule.name == "all" for job in workflow.dag.jobs
    ):
        report_completed(PLAN)


wildcard_constraints:
    figure="|".join(map(re.escape, PLAN.single_figures)) or "(?!)",
    decade="|".join(PLAN.decades) or "(?!)",
    training="|".join(map(re.escape, PLAN.trainings)),
    experiment="|".join(map(re.escape, PLAN.experiments)),
    kind="subject|paper|disjoint|siblings",
    on="((test|sitting|views)-(test|unusual)/)?",


def settings(stage):
    return f"{OUT}/config/{stage}.yaml"


def command(stage):
    """Returns the command of a stage; its output goes to the console and the log."""
    return (
        f"{{{{ {shlex.quote(sys.executable)} -m relight.stages.{stage} "
        f'--config-dir {OUT}/config --config-name "$(basename {{input.cfg:q}} .yaml)" '
    )


def named(port, field):
    """Returns an argument `port=name`, quoted for the shell and for Hydra, which would convert null, true and 1e5."""
    return f'{port}="\'"{{{field}:q}}"\'" '


def files(paths):
    """Returns the user's files as inputs, without those whose names are unsafe; their stage reports these."""
    return [str(path) for path in paths if not is_unsafe_name(path)]


def several(port, words):
    """Returns an argument `port=[path,...]` for Hydra; scans, whose names may need quotes, are passed one by one."""
    if PLAN.scans:
        return f"{port}={words} "
    return f'{port}="[$(echo {words} | tr " " ,)]" '


def decade(folder):
    """Returns the patterns of the records of a decade's figures in a folder."""
    return [f"{OUT}/{folder}/{{decade}}{digit}.npz" for digit in range(10)]


def maps_of(names):
    """Returns the patterns of the maps of figures: frontal ones, and further views."""
    views = [view for name in names for view in PLAN.maps(name)[1:]]
    found = {"frontal": names, "views": views}
    return {
        kind: [ensure(f"{OUT}/maps/{name}.exr", non_empty=True) for name in paths]
        for kind, paths in found.items()
    }


def split_of(training):
    """Returns the file of the split on which a network is trained and scored."""
    return f"{OUT}/split/{PLAN.settings(training)['split']['kind']}.json"


def condition(folder):
    """Returns the argument for the figures and lights of a folder of scores: "" or "sitting-test/"."""
    return f"io.condition={Path(folder).name or 'test'}"


def networks_of(experiment):
    """Returns the networks of all trainings of an experiment's rows."""
    if experiment not in PLAN.experiments:
        return []
    rows = PLAN.experiments[experiment].rows
    return [
        PLAN.network(training) for row in rows for training in PLAN.trainings_of(row)
    ]


# The braces hide the shell's message about a killed command, which the logger reports. The header of a stage's log
# (relight.stages.stage), whose lines start with "# ", is not printed on the console.
LOGGED = " 2>&1; }} 2>/dev/null | tee {log:q} | sed -u '\\,^# ,d'"
LOGGED_TRAINING = LOGGED + """ | sed -u s,^,{rule:q}" "{wildcards.training:q}": ","""
