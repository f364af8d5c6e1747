"""The folder results/<name>/config: the settings of each stage, lists of names, and the experiments, as files.

The files are in Snakemake's graph, so that a change of what they hold re-runs the stages that read them.
"""

import json
from dataclasses import asdict
from typing import Any

import yaml
from omegaconf import OmegaConf

from relight.code import code_hash, save_cache
from relight.config import READS, ROOT, flat, view
from relight.errors import UserError
from relight.files import atomic_write
from relight.plan import Plan

# Settings of Hydra at the top of each stage's file: no logs and no folders of its own.
HEAD = """\
defaults: [schema, _self_, override hydra/job_logging: none, override hydra/hydra_logging: none]
hydra: {run: {dir: .}, output_subdir: null, job: {chdir: false}}
"""
LISTS = ("figures.txt", "maps.txt", "experiments.json")  # the files that are not settings of a stage


class ConfigFolder:
    """What the files of results/<name>/config hold by a plan, and what they held when the results were made."""

    def __init__(self, plan: Plan):
        self.plan = plan
        self.path = ROOT / plan.out / "config"

    def text(self, file: str) -> str:
        """Returns the text of a file by its name: one of LISTS, or `<stage>.yaml` (`stage_settings`)."""
        if file == "figures.txt":
            return "".join(f"{figure}\n" for figure in self.plan.figures)
        if file == "maps.txt":
            return "".join(f"{name}\n" for name in self.plan.map_names)
        if file == "experiments.json":
            return self.experiments_json()
        return self.stage_settings(file.removesuffix(".yaml"))

    def stage_settings(self, stage: str) -> str:
        """Returns the text of the settings file of a stage, in YAML: its settings, and the hash of its code.

        A stage in `pin` keeps the hash that its file has.

        Args:
            stage: `stage`, `train.<training>` or `split.<kind>`.

        Raises:
            UserError: if there is no such training.
        """
        stage_name, _, part = stage.partition(".")
        plan = self.plan
        if stage_name == "split":
            tree = {**plan.shared, "split": {**plan.shared["split"], "kind": part}}
        elif part and part not in plan.trainings:
            raise UserError(f"no training {part}; there are {', '.join(plan.trainings)}")
        else:
            tree = plan.settings(part) if part else plan.shared
        settings = view(tree, stage_name)
        pinned = self.recorded(stage).get("code") if stage_name in plan.cfg.pin else None
        settings["code"] = pinned or code_hash(stage_name, extension_names(settings))
        return HEAD + OmegaConf.to_yaml(settings)

    def experiments_json(self) -> str:
        """Returns the experiments as JSON, for the report.

        Each has its fields, and its `trainings` by row. Tables also have files in results/<name>: their
        `scores`, those on the `usual` figures and lights, and the `splits` of their rows. An experiment that is
        left out has its missing files in `failed`.
        """
        plan = self.plan
        described = {}
        for name, experiment in plan.requested.items():
            trainings = {row: plan.trainings_of(row) for row in experiment.rows}
            described[name] = {**asdict(experiment), "trainings": trainings}
            if name in plan.failed:
                described[name]["failed"] = plan.failed[name]
            elif experiment.table:
                kinds = {row: plan.row_settings.of(row)["split"]["kind"] for row in experiment.rows}
                described[name] |= {
                    "scores": plan.scores(name),
                    "usual": plan.scores(name, usual=True),
                    "splits": {row: f"split/{kind}.json" for row, kind in kinds.items()},
                }
        return json.dumps(described, indent=1)

    def update(self) -> None:
        """Writes the existing files that differ, so that what reads them is made again.

        Snakemake compares with its records, and has none of a folder that was copied or moved: there, dates decide.
        """
        for file in sorted(self.path.glob("*")):
            if not (file.name in LISTS or (file.suffix == ".yaml" and self._is_in_plan(file.stem))):
                continue
            if file.read_bytes() != (text := self.text(file.name).encode()):
                with atomic_write(file) as tmp:
                    tmp.write_bytes(text)

    def recorded(self, stage: str) -> dict[str, Any]:
        """Returns the settings with which the results of a stage were made; empty if there is no such record.

        Args:
            stage: as in `stage_settings`: the name of the file without its suffix.
        """
        try:
            recorded = yaml.safe_load((self.path / f"{stage}.yaml").read_text(encoding="utf-8"))
        except (OSError, ValueError, yaml.YAMLError):
            return {}
        return recorded if isinstance(recorded, dict) else {}

    def changes(self) -> dict[str, list[str]]:
        """Returns what differs from the settings with which existing results were made.

        Returns:
            stage -> keys of settings, such as loss.albedo, and "code" for its code.
        """
        differing: dict[str, set[str]] = {}
        for file in sorted(self.path.glob("*.yaml")):
            if self._is_in_plan(file.stem):
                before, now = flat(self.recorded(file.stem)), flat(yaml.safe_load(self.stage_settings(file.stem)))
                keys = {key for key in before.keys() | now.keys() if before.get(key) != now.get(key)}
                differing.setdefault(file.stem.partition(".")[0], set()).update(keys)
        save_cache()
        return {stage: sorted(keys) for stage, keys in differing.items() if keys}

    def _is_in_plan(self, stage: str) -> bool:
        """Returns whether the plan has a stage and, if its name ends in one, the training: `train.ours_full.s0`."""
        stage_name, _, part = stage.partition(".")
        return stage_name in READS and (not part or stage_name == "split" or part in self.plan.trainings)


def extension_names(settings: dict[str, Any]) -> frozenset[str]:
    """Returns what a stage's settings name where extensions may be named: its network, losses and source of figures."""
    values, losses = flat(settings), settings.get("loss", {}).get("extra", {})
    return frozenset({values.get("model.name"), values.get("figures.source"), *losses})
