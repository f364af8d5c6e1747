"""The record of a run: its settings, composed and checked once, from which the workflow is planned."""

import hashlib
import itertools
import re
import shlex
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from relight.core.errors import UserError
from relight.settings import CONF, MAX_NAME_LENGTH, Config, Experiment, check_name, composed, flat
from relight.settings.composition import quoted

ROW_GROUPS = ("model", "loss", "train", "augment")  # that rows may change
Record = dict[str, Any]
PARTS = ("overrides", "settings", "rows", "failed")  # of a record


def compose_run(overrides: list[str], rows: Mapping[str, list[str]] | None = None) -> Record:
    """Composes and checks the settings of a run and of each of its rows.

    Args:
        overrides: settings to override, in the syntax of Hydra.
        rows: name -> overrides, of a sweep: they replace the rows, and all experiments by one table of them.

    Returns:
        The record. `overrides`: as given. `settings`: those that all rows share, as plain values by group. `rows`:
        name -> the ROW_GROUPS of the row.

    Raises:
        UserError: if a setting is invalid, or a row changes one that all rows share.
    """
    settings: Any = OmegaConf.to_container(composed(overrides))
    words = settings["sweep"]["rows"] if rows is None else {name: list(row) for name, row in rows.items()}
    by_row = {name: _row_settings(name, [*overrides, *row], settings) for name, row in words.items()}
    if rows is not None:
        settings["sweep"]["rows"] = words
        settings["experiments"] = {"sweep": asdict(Experiment(rows=list(words), plates=True))}
    return {"overrides": list(overrides), "settings": settings, "rows": by_row}


def from_config(config: dict[str, Any]) -> Record:
    """Returns the record of a run by Snakemake's configuration: a record, or settings to compose it from.

    Args:
        config: a record; or `hydra`, overrides as a list or as one string of words, and any other setting by its name,
            as in `--config scale=smoke`.

    Raises:
        UserError: if a setting is invalid, or given beside a record.
    """
    if "settings" in config:
        for key in config.keys() - {*PARTS, "job"}:  # which the Snakefile adds for jobs
            raise UserError(f"{key} is given beside the record of a run, which has all settings: give one of the two")
        name, record = config["settings"].get("name"), {key: config[key] for key in PARTS if key in config}
        words = [word.rpartition("=")[2] for word in sys.argv if Path(word).name == "run.yaml"]
        for folder in (Path(word).resolve().parent for word in words):
            if folder.parent.name == "results" and folder.name != name:
                raise UserError(
                    f"{folder}/run.yaml is a copy of that of {name}: relight run name={folder.name} goes on"
                )
        rows = {name: _with_defaults(row, ROW_GROUPS) for name, row in record["rows"].items()}
        return {**record, "settings": _with_defaults(record["settings"]), "rows": rows}
    keys = [re.sub("=.*", "", word).replace("-C", "--config") for word in sys.argv]
    for key in (key for key in ("--config", "hydra") if keys.count(key) > 1):
        raise UserError(f'Snakemake drops one of two {key}: write --config scale=smoke hydra="name=mine"')
    words = config.get("hydra") or []
    given = flat({key: value for key, value in config.items() if key != "hydra"})
    named = [f"{key}={'null' if value is None else str(value)}".replace("'", "") for key, value in given.items()]
    return compose_run([*named, *(shlex.split(words) if isinstance(words, str) else map(str, words))])


def read_record(folder: Path) -> Record:
    """Reads the record of a run (run.yaml) in its results; without one, all parts are empty."""
    nothing: Record = {"overrides": [], "settings": {}, "rows": {}}
    try:
        return {**nothing, **yaml.safe_load((folder / "run.yaml").read_text(encoding="utf-8"))}
    except (OSError, TypeError, ValueError, yaml.YAMLError):
        return nothing


def _with_defaults(settings: dict[str, Any], groups: Iterable[str] = tuple(Config.__annotations__)) -> dict[str, Any]:
    """Returns groups of settings of a record, with the defaults of those that are newer than the record."""
    try:
        full = OmegaConf.merge(OmegaConf.masked_copy(OmegaConf.structured(Config), list(groups)), settings)
        return cast(dict[str, Any], OmegaConf.to_container(full, throw_on_missing=True))
    except OmegaConfBaseException as error:
        reason = str(error).partition("\n")[0]
        raise UserError(
            f"this record of a run is of another version of relight ({reason}): begin with relight run"
        ) from None


def _row_settings(row: str, overrides: list[str], shared: dict[str, Any]) -> dict[str, Any]:
    """Checks the name of a row, and composes and checks its ROW_GROUPS from all overrides, its own last."""
    check_name("rows", row)
    for word in overrides:
        if word.lstrip("+").startswith("train.seed="):
            raise UserError(f"{word}: give the seeds of all trainings, sweep.seeds=[{word.partition('=')[2]}]")
    settings: Any = OmegaConf.to_container(composed(overrides))
    for group, expected in shared.items():
        if group not in ROW_GROUPS and settings[group] != expected:
            raise UserError(f"row {row} changes {group}, which all rows share: change it for all, under a new name")
    if settings["train"]["start"] == row:
        raise UserError(f"row {row}: train.start={row} is the row itself: name another row")
    return {group: settings[group] for group in ROW_GROUPS}


def expand_sweep(overrides: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Expands a sweep to rows: one for each combination of the overrides with several values.

    Args:
        overrides: settings to override, in the syntax of Hydra; several values are written as train.lr=1e-4,2e-4.

    Returns:
        The overrides with one value, and the overrides of each row by its name.

    >>> expand_sweep(["train.lr=1e-4,2e-4", "scale=demo"])
    (['scale=demo'], {'lr_0.0001': ['train.lr=0.0001'], 'lr_0.0002': ['train.lr=0.0002']})

    Raises:
        UserError: if an override cannot be parsed or is an interval, or none has several values.
    """
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    fixed, axes = [], []
    overrides = [override if "," in override else quoted(override) for override in overrides]
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            parser = OverridesParser.create(GlobalHydra.instance().config_loader())  # expands glob(*)
            for text, override in zip(overrides, parser.parse_overrides(overrides)):
                if not override.is_sweep_override():
                    fixed.append(text)
                elif override.is_interval_sweep():
                    raise UserError(f"{text} is not a list of values: write them out, as in train.lr=1e-4,2e-4")
                else:
                    axes.append([(override.get_key_element(), value) for value in override.sweep_string_iterator()])
    except HydraException as error:
        raise UserError(f"cannot read the overrides: {' '.join(str(error).split())}") from None
    if not axes:
        raise UserError("-m sweeps over lists, such as train.lr=1e-4,2e-4: give an override with several values")
    rows: dict[str, list[str]] = {}
    for choice in itertools.product(*axes):
        words = [f"{key}={value}" for key, value in choice]
        name = "-".join(f"{key.lstrip('+').rpartition('.')[2]}_{value}" for key, value in choice)
        safe_name = re.sub(r"[^A-Za-z0-9._+-]+", "_", name)
        if len(safe_name) > MAX_NAME_LENGTH or rows.get(safe_name, words) != words:
            ending = f"-{hashlib.sha256(name.encode()).hexdigest()[:8]}"  # makes a cut or an ambiguous name unique
            safe_name = safe_name[: MAX_NAME_LENGTH - len(ending)] + ending
        rows[safe_name] = words
    return fixed, rows
