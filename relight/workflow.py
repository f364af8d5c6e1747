"""What the Snakefile asks: the figures, the runs and the settings of a plan."""

import json
import shlex
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from relight.config import Experiment, composed, view
from relight.files import UserError

HEAD = """\
defaults: [schema, _self_, override hydra/job_logging: none, override hydra/hydra_logging: none]
hydra: {run: {dir: .}, output_subdir: null, job: {chdir: false}}
"""


class Plan:
    """The settings of one invocation, composed once; those of a run of the sweep, when they are asked for.

    `config` is Snakemake's: `hydra` holds overrides (a list, or one string of words), `runs` (optional) replaces the
    sweep's runs and all experiments but one table of them. Raises UserError in one line when a setting, a folder or a
    file is not as it must be.

    rows: what may be trained, name -> overrides; runs: rows x seeds; experiments: the sections of the report, each with
    those of its rows that `sweep.only` leaves; scored: the runs that the tables among them need.
    """

    def __init__(self, config: dict):
        overrides = config.get("hydra") or []
        self.overrides = shlex.split(overrides) if isinstance(overrides, str) else list(overrides)
        self.cfg = composed(self.overrides)
        self.out = f"results/{self.cfg.name}"
        self.rows = config.get("runs") or OmegaConf.to_container(self.cfg.sweep.runs)
        self.runs = {f"{row}.s{seed}": (row, seed) for row in self.rows for seed in self.cfg.sweep.seeds}
        self.experiments = self._experiments(swept="runs" in config)
        self.gpus = int(self.cfg.train.device == "cuda")  # what a training asks of a cluster
        self.composed: dict[str, DictConfig] = {}

    def look(self) -> None:
        """Looks at the user's folders: what is wrong with them is told before anything runs."""
        _ = self.figures, self.panoramas

    def _experiments(self, swept: bool) -> dict[str, Experiment]:
        wanted = set(self.cfg.sweep.only or self.rows)
        if unknown := wanted - set(self.rows):
            raise UserError(f"sweep.only: no run {min(unknown)}; there are {', '.join(self.rows)}")
        if swept:
            return {"sweep": Experiment(rows=list(self.rows), plates=True)}
        given = OmegaConf.to_object(self.cfg.experiments)
        found = {name: replace(e, rows=[row for row in e.rows if row in wanted]) for name, e in given.items()}
        return {name: experiment for name, experiment in found.items() if experiment.rows}

    @property
    def scored(self) -> list[str]:
        """The runs that the tables compare."""
        rows = {row for experiment in self.experiments.values() if experiment.table for row in experiment.rows}
        return [run for run, (row, _) in self.runs.items() if row in rows]

    @cached_property
    def scans(self) -> dict:
        """The user's meshes by name; empty when figures are generated."""
        if self.cfg.figures.source == "generated":
            return {}
        from relight.meshes.scans import list_scans

        return list_scans(self.cfg.figures.folder)

    @property
    def table(self) -> list[str]:
        """The table that picks and names scans, where the user's folder has one."""
        from relight.meshes.scans import TABLE

        table = Path(self.cfg.figures.folder or "") / TABLE
        return [str(table)] if table.is_file() else []

    @cached_property
    def figures(self) -> list[str]:
        """Names of the figures: a seed each, or a scan each."""
        first, count = self.cfg.figures.first, self.cfg.figures.count
        return list(self.scans) or [f"g{seed:04d}" for seed in range(first, first + count)]

    @cached_property
    def panoramas(self) -> list[str]:
        """Files of the user's panoramas; empty when rooms are generated."""
        if self.cfg.panoramas.source == "generated":
            return []
        from relight.panoramas.read import panoramas_in

        folder = self.cfg.panoramas.folder
        return [f"{folder}/{name}" for name in panoramas_in(folder)]

    @property
    def tables(self) -> list[str]:
        """The experiments that are tables of trainings."""
        return [name for name, experiment in self.experiments.items() if experiment.table]

    def of_run(self, run: str) -> DictConfig:
        """The settings of one run of the sweep."""
        if run not in self.composed:
            row, seed = self.runs[run]
            self.composed[run] = composed([*self.overrides, *self.rows[row], f"train.seed={seed}"])
        return self.composed[run]

    def settings(self, stage: str) -> str:
        """The YAML file that `stage`, or `stage.run`, reads."""
        stage, _, run = stage.partition(".")
        if run and run not in self.runs:
            raise UserError(f"no run {run}; there are {', '.join(self.runs)}")
        return HEAD + OmegaConf.to_yaml(OmegaConf.create(view(self.of_run(run) if run else self.cfg, stage)))

    def listing(self, name: str) -> str:
        """`figures`, or `runs` (those that the tables compare), one per line."""
        return "".join(f"{item}\n" for item in {"figures": self.figures, "runs": self.scored}[name])

    def asked(self) -> str:
        """The experiments as JSON: the fields of each, and `runs`, its trainings by row."""
        runs = {row: [run for run, (own, _) in self.runs.items() if own == row] for row in self.rows}
        made = {
            name: {**asdict(experiment), "runs": {row: runs[row] for row in experiment.rows}}
            for name, experiment in self.experiments.items()
        }
        return json.dumps(made, indent=1)
