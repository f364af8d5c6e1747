import os
import re
import shlex
import shutil
import sys
from pathlib import Path

ROOT = Path(workflow.current_basedir).parents[1]
sys.path.insert(0, str(ROOT))
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
)

from snakemake.exceptions import WorkflowError

from relight.core.errors import UserError
from relight.lab.checks import check
from relight.lab.code import code_hash
from relight.lab.plan import Plan, safe, stamps
from relight.lab.run import hold
from relight.lab.record import from_config
from relight.settings.scores import BASELINES, QUANTITIES, READINGS, ROWS

try:
    PLAN = Plan(from_config(config))
    check(PLAN, Path())
except UserError as error:
    raise WorkflowError(str(error)) from None
OUT, DATA, SETTINGS = PLAN.out, PLAN.data, PLAN.shared
LIGHTS, PACKED = f"{DATA}/lights/lights.npz", f"{DATA}/packed.safetensors"
SPLIT = f"{OUT}/split.json"
# The settings are no code: what of relight.settings.scores decides scores, and what decides the report.
SCORED = [*((name, one.span) for name, one in QUANTITIES.items()), *READINGS]
REPORTED = repr([QUANTITIES, READINGS, BASELINES, ROWS])
# What jobs need to know, and what is no reason to run them again.
config["process"], config["tracking"] = os.getpid(), PLAN.tracking()
config["least"] = SETTINGS["split"]["least"]
sys.executable = shlex.quote(
    sys.executable
)  # Snakemake pastes it into the command of a script


onstart:
    hold(OUT)
    if DATA != OUT:
        hold(DATA, shared=True)
    PLAN.write_record(Path())


onsuccess:
    # The states of trainings are kept until Snakemake has recorded their outputs, which it deletes otherwise.
    for training in PLAN.trainings:
        if Path(PLAN.network(training)).exists():
            shutil.rmtree(f"{OUT}/train/state/{training}", ignore_errors=True)


wildcard_constraints:
    batch="|".join(map(re.escape, PLAN.batches)),
    training="|".join(map(re.escape, PLAN.trainings)),
    experiment="|".join(map(re.escape, PLAN.experiments)),
    on="((test|sitting)-(test|unusual)/)?",
