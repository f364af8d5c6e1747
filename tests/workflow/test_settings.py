"""What --help tells of the settings, and what shells complete."""

import os
import subprocess
import sys

import pytest
import yaml

from relight.config import READS, ROOT, Config, composed
from relight.settings import complete, descriptions, listing, overview


def test_every_setting_is_told_with_its_value():
    told = overview(composed(["scale=smoke"]))
    for group, field in Config.__dataclass_fields__.items():
        for name in getattr(field.type, "__dataclass_fields__", ()):
            if group not in ("sweep", "experiments") and name != "rules":
                assert f" {group}.{name}=" in told, (group, name)
    (line,) = (line for line in told.splitlines() if " figures.count=" in line)
    assert line.split() == ["figures.count=6", "how", "many", "seeds"]
    assert descriptions()["Train", "pairs"].startswith("shuffled | rows"), "of a field over several lines"


@pytest.mark.parametrize("stage", READS)
def test_a_stage_tells_what_it_reads(stage):
    told = listing(composed(), READS[stage])
    assert all(f" {key}" in told for key in READS[stage])
    assert ("figures.count" in told) == ("figures" in READS[stage])


@pytest.mark.parametrize(
    ("args", "incomplete", "found"),
    [
        ([], "sca", ["scale="]),
        ([], "train.lr", ["train.lr="]),
        ([], "scale=sm", ["scale=smoke"]),
        (["scale", "="], "sm", ["smoke"]),  # bash
        (["scale"], "", ["demo", "laptop", "paper", "smoke", "study"]),
        ([], "train.optimizer=", ["train.optimizer=adam", "train.optimizer=adamw"]),
        ([], "model.refine=t", ["model.refine=true"]),
        ([], "nothing", []),
        ([], "train.lr=1", []),
        (["scale=smoke"], "", None),
    ],
)
def test_completion(args, incomplete, found):
    words = complete(args, incomplete)
    assert words == found if found is not None else len(words) > 100 and "bake.rays=" in words


def test_the_command_line_completes_and_prints_its_settings():
    def relight(*words: str, **environment: str) -> str:
        command = [sys.executable, "-c", "from relight.cli import app; app(prog_name='relight')", *words]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    words = {"_RELIGHT_COMPLETE": "complete_bash", "COMP_WORDS": "relight run scale = sm", "COMP_CWORD": "4"}
    assert relight(**words).split() == ["smoke"]
    printed = yaml.safe_load(relight("run", "--cfg", "job", "scale=smoke", "train.lr=0.5"))
    assert printed["train"]["lr"] == 0.5 and printed["name"] == "smoke" and "hydra" not in printed
