import os
import re
import shlex
import shutil
import sys
from pathlib import Path

if not isinstance(workflow.current_basedir, (str, os.PathLike)):
    raise ValueError(
        "relight's workflow needs its clone: give `module` the path of one"
    )
ROOT = Path(workflow.current_basedir).parents[1]
sys.path.insert(0, str(ROOT))
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
)

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from relight.core.errors import UserError
from relight.lab.checks import changes, check
from relight.lab.made import is_made
from relight.lab.plan import Plan, safe
from relight.lab.record import from_config
from relight.lab.run import HOLDER, hold_all
from relight.settings.scores import BASELINES, QUANTITIES, READINGS, ROWS

try:
    PLAN = Plan(from_config(config))
    check(PLAN)
    if workflow.is_main_process:
        held = os.environ.get(HOLDER) == str(os.getppid())  # by `relight run`
        for line in changes(PLAN, lambda: held or hold_all(PLAN, Path())):
            logger.warning(line)
except UserError as error:
    raise WorkflowError(str(error)) from None
OUT, DATA, SETTINGS = PLAN.out, PLAN.data, PLAN.shared
LIGHTS, PACKED = f"{DATA}/lights/lights.npz", f"{DATA}/packed.safetensors"
SPLIT = f"{OUT}/split.json"
# The settings are no code: what of relight.settings.scores decides scores, and what decides the report.
SCORED = repr([[(name, one.span) for name, one in QUANTITIES.items()], [*READINGS]])
REPORTED = repr([QUANTITIES, READINGS, BASELINES, ROWS])
# What jobs need to know, and what is no reason to run them again.
config["job"] = {
    "process": os.getpid(),
    "tracking": PLAN.tracking(),
    "least": SETTINGS["split"]["least"],
}
EDGE = -(-SETTINGS["bake"]["size"] // 256)  # of pictures, in 256 pixels


def memory(wildcards, attempt):
    "MB of a job that works on pictures; more at the next attempt, after it was killed."
    return 6000 * EDGE * attempt


def minutes(wildcards, attempt):
    "Minutes of a job that bakes or scores."
    return 60 * EDGE**2 * attempt


def shown(path, category, **labels):
    "A file that `snakemake --report` shows, with the caption of its category."
    caption = f"../report/{category.lower()}.rst"
    return report(update(path), caption=caption, category=category, labels=labels)


# Snakemake pastes it into the command of a script.
sys.executable = shlex.quote(sys.executable)


onstart:
    workflow.persistence.cleanup_backup(Path(OUT))  # of jobs that were killed
    PLAN.write_record()


onsuccess:
    # The states of trainings are kept until Snakemake has recorded their outputs, which it deletes otherwise.
    for training in PLAN.trainings:
        if is_made(PLAN.network(training)):
            shutil.rmtree(f"{OUT}/train/state/{training}", ignore_errors=True)


wildcard_constraints:
    batch="|".join(map(re.escape, PLAN.batches)),
    training="|".join(map(re.escape, [*PLAN.trainings, "baselines"])),
    experiment="|".join(map(re.escape, PLAN.experiments)),
    on="((test|sitting)-(test|unusual)/)?",
