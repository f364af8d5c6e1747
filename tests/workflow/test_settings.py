"""Settings for people: --help, and the site's page."""

import re
import runpy
import subprocess
import sys

import pytest
import yaml

from relight.settings import ROOT, composed, presets
from relight.settings.help import overview
from relight.settings.schema import FIELDS


def test_help_has_every_setting_with_its_value_and_description():
    text = overview(composed(["scale=smoke"]))
    for key in FIELDS:
        assert key in ("sweep.rows", "name") or f" {key}=" in text, key
    words = " ".join(text.split())
    assert "figures.count=6 number of seeds (at least 1)" in words
    assert "train.optimizer=adam Adam, or Muon for convolutions with a norm (one of adam, muon)" in words
    assert max(map(len, text.splitlines())) <= 110


def test_the_page_of_settings_has_every_setting_and_preset():
    page = runpy.run_path(str(ROOT / "tools" / "settings.py"))["page"]()
    groups = page.partition("\n## name\n")[2]
    assert re.findall(r"^\| `([\w.]+)` \| .* \| .+ \| .+ \|$", groups, re.M) == [key for key in FIELDS if "." in key]
    named = re.findall(r"^- `(\w+)=(\w+)`", page, re.M)
    chosen = {group: names for group, names in presets().items() if len(names) > 1 or group == "protocol"}
    assert set(named) == {(group, name) for group, names in chosen.items() for name in names}


@pytest.mark.slow
def test_the_command_line_prints_its_settings():
    words = ["run", "--cfg", "job", "scale=smoke", "train.lr=0.5"]
    command = [sys.executable, "-c", "from relight.cli import app; app(prog_name='relight')", *words]
    printed = yaml.safe_load(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert printed["train"]["lr"] == 0.5 and printed["name"] == "smoke" and "hydra" not in printed
