"""Plans a workflow for the Snakefile: its figures, trainings, experiments and settings."""

import json
import os
import shlex
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from functools import cached_property, partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from omegaconf import OmegaConf

from relight.config import ROOT, Experiment, check_name, composed
from relight.errors import UserError
from relight.files import atomic_write, existing_file, remove_folder
from relight.processes import end_with_parent, git
from relight.rows import RowSettings
from relight.training_name import TrainingName

if TYPE_CHECKING:
    from relight.meshes.scans import Scan

USUAL_CONDITION = ("test", "test")  # the figures and lights of the tables
MAX_TAG = 5000  # characters of a tag in MLflow
MAX_CLOCK_SKEW = 60  # seconds by which the clock of a file server may be ahead
FAILED_VARIABLE = "RELIGHT_FAILED"  # environment variable with Plan.failed as JSON


class Plan:
    """The plan of one workflow.

    A *row* is a named set of overrides, that is, of one row of the tables. A *training* is a row with a seed.

    Attributes:
        overrides: settings to override, in the syntax of Hydra, as given.
        cfg: the settings that all rows share.
        out: the folder of the results, relative to the repository.
        rows: name -> overrides, of all that may be trained.
        trainings: name -> TrainingName, for all rows and seeds.
        is_sweep: whether the rows are those of `relight run -m`.
        requested: name -> experiment, with the rows that are selected and not duplicates.
        failed: experiments to leave out -> their missing files.
        experiments: the requested ones that did not fail.
    """

    def __init__(self, config: dict[str, Any], failed: dict[str, list[str]] | None = None):
        """Composes the settings.

        Args:
            config: that of Snakemake. `hydra` contains overrides, as a list or one string of words. `rows`, if given,
                replaces the rows, and all experiments by one table of them.
            failed: experiments to leave out -> their missing files.

        Raises:
            UserError: if a setting or a name is invalid.
        """
        if unknown := sorted(set(config) - {"hydra", "rows"}):
            word = f"{unknown[0]}={config[unknown[0]]}"
            raise UserError(f'--config {word}: write the settings as one word, --config hydra="{word}"')
        overrides = config.get("hydra") or []
        self.overrides = shlex.split(overrides) if isinstance(overrides, str) else list(overrides)
        self.cfg = composed(self.overrides)
        self.out = f"results/{self.cfg.name}"
        for row in config.get("rows") or ():
            check_name("rows", row)
        rows: Any = config.get("rows") or OmegaConf.to_container(self.cfg.sweep.rows)
        self.rows: dict[str, list[str]] = rows
        names = [TrainingName(row, seed) for row in self.rows for seed in self.cfg.sweep.seeds]
        self.trainings = {str(name): name for name in names}
        self.is_sweep = "rows" in config
        self.requested = self._requested()
        self.failed = failed or {}
        self.experiments = {name: experiment for name, experiment in self.requested.items() if name not in self.failed}
        self.gpus = int(self.cfg.train.device == "cuda")  # requested by each training on a cluster
        self.row_settings = RowSettings(self.overrides, self.rows, self.shared)

    def check(self) -> None:
        """Checks the settings of all rows and the user's folders, so that errors are reported before anything runs.

        Raises:
            UserError: if a row, a folder, a file or a missing package would make the workflow fail later.
        """
        inputs = [scan.path for scan in self.scans.values()]
        inputs += [*map(Path, self.table), *map(Path, self.panoramas)]
        tables = {"align.table": self.cfg.align.table, "lights.veto": self.cfg.lights.veto}
        inputs += [existing_file(path, key) for key, path in tables.items() if path]
        limit = time.time() + MAX_CLOCK_SKEW
        for path in inputs:  # Snakemake ends a job whose outputs are older than its inputs
            if path.exists() and path.stat().st_mtime > limit:
                raise UserError(f"{path} is dated in the future: correct this machine's clock, or `touch` the file")
        if "path_traced" in self.experiments and find_spec("mitsuba") is None:
            raise UserError("experiment=path_traced needs Mitsuba, which is not installed here: pip install '.[bench]'")
        if "path_traced" in self.experiments and self.cfg.bake.bounces:
            raise UserError("experiment=path_traced separates direct from bounced light, and needs bake.bounces=0")
        self._check_rows()

    def check_figures(self) -> None:
        """Checks that there are figures for training and for testing.

        Raises:
            UserError: if there is only one figure.
        """
        if len(self.figures) < 2:
            raise UserError(
                f"a training and its test need at least two figures, and there is only {self.figures[0]}: "
                "`relight bake MESH --out FILE.exr` bakes one mesh"
            )

    def _check_rows(self) -> None:
        """Checks the settings of all rows, and that those of a table can be compared with its baselines."""
        self.row_settings.compose_all()
        for row in self.rows:
            settings = self.row_settings.of(row)
            if (start := settings["train"]["start"]) and start not in self.rows:
                existing_file(start, f"row {row}: train.start")
            if settings["model"]["order"] > self.cfg.bake.order:
                raise UserError(
                    f"row {row} has model.order={settings['model']['order']}, and the maps have bake.order="
                    f"{self.cfg.bake.order}: give a bake.order as high"
                )
        for row in dict.fromkeys(row for name in self.tables for row in self.experiments[name].rows):
            train = self.row_settings.of(row)["train"]
            if train["color"] != self.cfg.train.color:
                raise UserError(
                    f"row {row} has train.color={train['color']}, and the baselines {self.cfg.train.color}: their "
                    f"errors cannot be compared; give train.color={train['color']} to the run, under a new name"
                )
            if train["size"] not in (None, self.cfg.bake.size):
                raise UserError(
                    f"row {row} has train.size={train['size']}, and is tested on maps of "
                    f"bake.size={self.cfg.bake.size}: give one size, or let another row start from it"
                )

    def write_record(self, folder: Path | str) -> Path:
        """Writes the given overrides and rows to run.yaml in the results.

        Args:
            folder: the repository.

        Returns:
            The file, which is not touched if its content is already right.
        """
        requested = {"hydra": self.overrides, **({"rows": self.rows} if self.is_sweep else {})}
        file, text = Path(folder) / self.out / "run.yaml", yaml.safe_dump(json.loads(json.dumps(requested)))
        if not file.exists() or file.read_text() != text:
            with atomic_write(file) as tmp:
                tmp.write_text(text)
        return file

    def clean_up(self, outputs: set[str]) -> None:
        """Removes the states of trainings, and an outdated snakemake.html, after a workflow that succeeded.

        States are needed until then: if Snakemake is killed before it records the outputs of a job, it deletes them. A
        snakemake.html that is older than the report describes an earlier one.

        Args:
            outputs: files of all jobs.
        """
        for training in self.trainings:
            network = Path(self.network(training))
            if str(network) in outputs:
                remove_folder(network.parent / "state" / training)
        report = Path(self.out, "report", "report.html")
        page = report.with_name("snakemake.html")
        if page.exists() and report.exists() and page.stat().st_mtime < report.stat().st_mtime:
            page.unlink()

    def _requested(self) -> dict[str, Experiment]:
        """Returns the experiments by name with the rows to train; see the attribute `requested`.

        Raises:
            UserError: if `sweep.only` names an unknown row.
        """
        selected = set(self.cfg.sweep.only or self.rows)
        if unknown := selected - set(self.rows):
            raise UserError(f"sweep.only: no row {min(unknown)}; there are {', '.join(self.rows)}")
        if self.is_sweep:
            return {"sweep": Experiment(rows=list(self.rows), plates=True)}
        given: Any = OmegaConf.to_object(self.cfg.experiments)
        experiments = {}
        for name, experiment in given.items():
            if rows := self._without_duplicates([row for row in experiment.rows if row in selected]):
                experiments[name] = replace(experiment, rows=rows)
        return experiments

    def _without_duplicates(self, rows: list[str]) -> list[str]:
        """Returns the rows without duplicates, which differ from another row only in overrides that have no effect."""
        effective = {row: [word for word in self.rows[row] if not self._has_no_effect(word)] for row in rows}
        return [
            row
            for row in rows
            if effective[row] == self.rows[row] or all(effective[row] != self.rows[other] for other in rows)
        ]

    def _has_no_effect(self, word: str) -> bool:
        """Returns whether an override of a row has no effect on its training.

        That is so for as many training figures as there are figures, or more, and for the width of the scale.
        """
        key, _, value = word.partition("=")
        if key == "train.figures" and value.isdigit():
            return int(value) >= len(self.figures)
        return word == f"model.width={self.cfg.model.width}"

    @property
    def scored(self) -> list[str]:
        """The trainings that the tables compare."""
        rows = {row for name in self.tables for row in self.experiments[name].rows}
        return [training for training, name in self.trainings.items() if name.row in rows]

    def condition_folder(self, experiment: str) -> str:
        """Returns the folder of an experiment's scores in evaluate/: "" for USUAL_CONDITION, or "sitting-test/"."""
        figures, lights = self.experiments[experiment].figures, self.experiments[experiment].lights
        return "" if (figures, lights) == USUAL_CONDITION else f"{figures}-{lights}/"

    @cached_property
    def shared(self) -> dict[str, Any]:
        """`cfg` as plain values by group."""
        tree: Any = OmegaConf.to_container(self.cfg)
        return dict(tree)

    @cached_property
    def scans(self) -> "dict[str, Scan]":
        """The user's meshes by name; empty for other sources."""
        if self.cfg.figures.source != "scans":
            return {}
        from relight.meshes import list_scans

        return list_scans(self.cfg.figures.folder)

    @property
    def table(self) -> list[str]:
        """The table of the scans, if the user's folder has one."""
        if not self.scans:
            return []
        from relight.meshes.scans import TABLE

        table = Path(self.cfg.figures.folder) / TABLE
        return [str(table)] if table.is_file() else []

    @cached_property
    def figures(self) -> list[str]:
        """Names of the figures, which are seeds or scans."""
        first, count = self.cfg.figures.first, self.cfg.figures.count
        return list(self.scans) or [f"g{seed:04d}" for seed in range(first, first + count)]

    @cached_property
    def decades(self) -> list[str]:
        """Decades of generated figures that are completely in the plan, by the common prefix of their names: g012."""
        count = Counter(name[:-1] for name in self.figures) if not self.scans else {}
        return [name for name, figures in count.items() if figures == 10]

    @cached_property
    def single_figures(self) -> list[str]:
        """The figures outside the decades; each has jobs of its own."""
        decades = set(self.decades)
        return [name for name in self.figures if name[:-1] not in decades]

    def maps(self, figure: str) -> list[str]:
        """Returns the names of the maps of a figure; the frontal view of its first outfit has the figure's name."""
        from relight.transport import outfit_names, view_names

        outfits = outfit_names(figure, self.cfg.figures.outfits)
        return [name for outfit in outfits for name in (outfit, *view_names(outfit, self.cfg.bake.views))]

    @cached_property
    def panoramas(self) -> list[str]:
        """Files of the user's panoramas; empty if panoramas are generated."""
        if self.cfg.panoramas.source == "generated":
            return []
        from relight.panoramas import list_panoramas

        folder = self.cfg.panoramas.folder
        return [f"{folder}/{name}" for name in list_panoramas(folder)]

    @property
    def tables(self) -> list[str]:
        """The experiments that are tables of trainings."""
        return [name for name, experiment in self.experiments.items() if experiment.table]

    @property
    def plates(self) -> list[str]:
        """The experiments whose networks are shown side by side."""
        return [name for name, experiment in self.experiments.items() if experiment.table and experiment.plates]

    def settings(self, training: str) -> dict[str, Any]:
        """Returns the settings of a training: those of its row, with its seed.

        If `train.start` names a row, the network of that row with the same seed takes its place.

        Args:
            training: name, a key of `trainings`.

        Returns:
            group -> setting -> value, for the groups `relight.rows.ROW_GROUPS`.

        Raises:
            UserError: if a setting is invalid, or the row changes one that all rows share.
        """
        name = self.trainings[training]
        groups = self.row_settings.of(name.row)
        start = groups["train"]["start"]
        if start in self.rows:
            start = self.network(f"{start}.s{name.seed}")
        return {**groups, "train": {**groups["train"], "seed": name.seed, "start": start}}

    def tracking(self) -> dict[str, Any]:
        """Returns what MLflow records of the workflow with each training (`relight.tracking.run.WORKFLOW`).

        Returns:
            `track`: the settings of the group `track`. `tags`: row -> name of a tag -> text.
        """
        tags = {"workflow": self.cfg.name, "settings": shlex.join(self.overrides)[:MAX_TAG]}
        if commit := git(ROOT, "rev-parse", "HEAD"):
            has_changes = bool(git(ROOT, "status", "--porcelain"))
            tags |= {"mlflow.source.git.commit": commit, "git.dirty": str(has_changes).lower()}
        tags_by_row = {}
        for row in self.rows:
            names = [name for name, experiment in self.experiments.items() if row in experiment.rows]
            tags_by_row[row] = {**tags, "experiment": ", ".join(names)}
        return {"track": self.shared["track"], "tags": tags_by_row}

    def network(self, training: str) -> str:
        """Returns the file of a trained network."""
        return f"{self.out}/train/{training}.safetensors"

    def start_network(self, training: str) -> list[str]:
        """Returns the file of the network from which a training starts, in a list; or []."""
        start = self.settings(training)["train"]["start"]
        return [start] if start else []

    def split_kind(self, experiment: str) -> str:
        """Returns the kind of split (`split.kind`) of an experiment's scores.

        It is that of the first row: rows with different splits must have the same test figures.
        """
        kind: str = self.row_settings.of(self.experiments[experiment].rows[0])["split"]["kind"]
        return kind

    def trainings_of(self, row: str) -> list[str]:
        """Returns the trainings of a row, one per seed."""
        return [training for training, name in self.trainings.items() if name.row == row]

    def scores(self, experiment: str, usual: bool = False) -> dict[str, list[str]]:
        """Returns the files of an experiment's scores, relative to `out`.

        Args:
            experiment: name.
            usual: for the usual figures and lights instead of the experiment's own.

        Returns:
            row -> a file for each of its trainings; "" -> the file of the baselines.
        """
        folder = "evaluate/" if usual else f"evaluate/{self.condition_folder(experiment)}"
        rows = self.experiments[experiment].rows
        files = {row: [f"{folder}{training}.csv" for training in self.trainings_of(row)] for row in rows}
        return {**files, "": [f"{folder}baselines.{self.split_kind(experiment)}.csv"]}

    @property
    def score_files(self) -> list[str]:
        """All files of scores that the report needs: by each experiment's own figures and lights, and by the usual."""
        tables = [self.scores(name, usual=usual) for name in self.tables for usual in (False, True)]
        files = (f"{self.out}/{path}" for rows in tables for paths in rows.values() for path in paths)
        return list(dict.fromkeys(files))

    def stage_outputs(self, experiment: str) -> list[str]:
        """Returns the files that the stages of an experiment without a table write for the report."""
        return [f"{self.out}/{experiment}/scores.csv", f"{self.out}/{experiment}/plate.png"]

    def missing_results(self, folder: Path | str) -> dict[str, list[str]]:
        """Returns the files that each experiment lacks after a workflow that failed.

        Args:
            folder: the repository.

        Returns:
            experiment -> files. Empty if shared files are missing or no experiment is complete, since then there is
            nothing to report.
        """

        def missing(paths: list[str]) -> list[str]:
            return [path for path in dict.fromkeys(paths) if not Path(folder, path).exists()]

        shared = [f"{self.out}/{path}" for path in ("packed.safetensors", "figures.json", "lights/lights.npz")]
        lacking = {}
        for name, experiment in self.experiments.items():
            trained = [self.network(training) for row in experiment.rows for training in self.trainings_of(row)]
            # An experiment with figures or lights of its own is scored on these and on the usual ones.
            scores = [path for usual in (False, True) for paths in self.scores(name, usual).values() for path in paths]
            files = [f"{self.out}/{path}" for path in scores] if experiment.table else self.stage_outputs(name)
            if absent := missing([*trained, *files]):
                lacking[name] = absent
        return {} if missing(shared) or len(lacking) == len(self.experiments) else lacking

    @property
    def map_names(self) -> list[str]:
        """The maps of all figures and their views."""
        return [name for figure in self.figures for name in self.maps(figure)]


def report_completed(plan: Plan) -> None:
    """Makes the report of the complete experiments after a workflow that failed, by calling Snakemake again.

    The sections of the other experiments name the missing files, which the next run will make.

    Args:
        plan: plan of this Snakemake process, whose jobs have ended.
    """
    failed = {} if plan.failed else plan.missing_results(".")
    if not failed:
        return
    command = [*sys.orig_argv, "--nolock"]  # this process holds the lock
    environment = {**os.environ, FAILED_VARIABLE: json.dumps(failed)}
    result = subprocess.run(command, env=environment, preexec_fn=partial(end_with_parent, os.getpid()))
    if result.returncode == 0:
        print(f"failed: {', '.join(failed)}; the report of the others: {plan.out}/report/report.html", file=sys.stderr)
