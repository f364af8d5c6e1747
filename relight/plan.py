"""Plans a workflow for the Snakefile: its figures, trainings, experiments and settings."""

import hashlib
import json
import os
import platform
import shlex
import subprocess
import sys
import time
from collections import Counter
from dataclasses import asdict, replace
from functools import cached_property, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from omegaconf import OmegaConf

from relight import config as schema
from relight.code import code_hash, save_cache
from relight.config import CONF, READS, ROOT, Experiment, check_name, composed, flat, view
from relight.errors import UserError
from relight.files import atomic_write, remove_folder
from relight.processes import end_with_parent, git
from relight.training_name import TrainingName

if TYPE_CHECKING:
    from relight.meshes.scans import Scan

HEAD = """\
defaults: [schema, _self_, override hydra/job_logging: none, override hydra/hydra_logging: none]
hydra: {run: {dir: .}, output_subdir: null, job: {chdir: false}}
"""
USUAL_CONDITION = ("test", "test")  # the figures and lights of the tables
MAX_TAG = 5000  # characters of a tag in MLflow
MAX_CLOCK_SKEW = 60  # seconds by which the clock of a file server may be ahead
LISTS = ("figures.txt", "maps.txt", "experiments.json")  # files of results/<name>/config beside the settings
# The groups that rows may change; of the split only its kind.
ROW_GROUPS = ("model", "loss", "train", "augment", "split", "timing", "track")
SETTINGS_CACHE = Path(".snakemake", "relight.settings.json")  # settings of rows, by the hash of their sources
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
            config: Snakemake's. `hydra` contains overrides, as a list or one string of words. `rows`, if given,
                replaces the rows, and all experiments by one table of them.
            failed: see the attributes.

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
        self._by_row: dict[str, dict[str, Any]] = {}
        self._by_training: dict[str, dict[str, Any]] = {}

    def check(self) -> None:
        """Checks the settings of all rows and the user's folders, so that errors are reported before anything runs.

        Raises:
            UserError: if a row, a folder, a file or a missing package would make the workflow fail later.
        """
        inputs = [scan.path for scan in self.scans.values()]
        inputs += [path for figure in self.captures for path in self.capture_files(figure)]
        inputs += [*map(Path, self.table), *map(Path, self.panoramas)]
        if "benchmark" in self.experiments:
            inputs.append(self.benchmark_index)
        limit = time.time() + MAX_CLOCK_SKEW
        for path in inputs:  # Snakemake ends a job whose outputs are older than its inputs
            if path.exists() and path.stat().st_mtime > limit:
                raise UserError(f"{path} is dated in the future: correct this machine's clock, or `touch` the file")
        if "path_traced" in self.experiments and self.captures:
            raise UserError("experiment=path_traced needs meshes, which figures.source=olat does not make")
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
        """Checks the settings of all rows. They are cached, since composing them takes seconds."""
        keys = {row: self._cache_key(row) for row in self.rows}
        try:
            cached = json.loads((ROOT / SETTINGS_CACHE).read_text())
        except (OSError, ValueError):
            cached = {}
        for row, key in keys.items():
            if isinstance(settings := cached.get(key), dict):
                self._by_row[row] = settings
            self._row_settings(row)
        if not set(keys.values()) <= set(cached) and (ROOT / SETTINGS_CACHE).parent.is_dir():
            try:
                with atomic_write(ROOT / SETTINGS_CACHE) as tmp:
                    tmp.write_text(json.dumps({key: self._by_row[row] for row, key in keys.items()}))
            except UserError:  # a read-only folder: settings are composed again next time
                pass
        for row in dict.fromkeys(row for name in self.tables for row in self.experiments[name].rows):
            train = self._row_settings(row)["train"]
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
        for network in filter(outputs.__contains__, map(self.network, self.trainings)):
            remove_folder(Path(network).parent / "state" / Path(network).stem)
        report = Path(self.out, "report", "report.html")
        page = report.with_name("snakemake.html")
        if page.exists() and report.exists() and page.stat().st_mtime < report.stat().st_mtime:
            page.unlink()

    def _requested(self) -> dict[str, Experiment]:
        selected = set(self.cfg.sweep.only or self.rows)
        if unknown := selected - set(self.rows):
            raise UserError(f"sweep.only: no row {min(unknown)}; there are {', '.join(self.rows)}")
        if self.is_sweep:
            return {"sweep": Experiment(rows=list(self.rows), plates=True)}
        given: Any = OmegaConf.to_object(self.cfg.experiments)
        experiments = {
            name: replace(
                experiment, rows=self._without_duplicates([row for row in experiment.rows if row in selected])
            )
            for name, experiment in given.items()
        }
        return {name: experiment for name, experiment in experiments.items() if experiment.rows}

    def _without_duplicates(self, rows: list[str]) -> list[str]:
        """Returns the rows without duplicates, which differ from another row only in overrides that have no effect."""
        effective = {row: [word for word in self.rows[row] if not self._has_no_effect(word)] for row in rows}
        return [
            row
            for row in rows
            if effective[row] == self.rows[row] or all(effective[row] != self.rows[other] for other in rows)
        ]

    def _has_no_effect(self, word: str) -> bool:
        """Returns whether an override requests all figures, or the width of the scale."""
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
        """Returns the folder of an experiment's scores in evaluate/: "" for the usual condition, or sitting-test/."""
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

    @cached_property
    def captures(self) -> dict[str, Path]:
        """The folders of a light stage's captures by name; empty for other sources."""
        if self.cfg.figures.source != "olat":
            return {}
        from relight.captures.capture import list_captures

        return list_captures(self.cfg.figures.folder, self.cfg.figures.only)

    def capture_files(self, figure: str) -> list[Path]:
        """Returns the input files and folders of a capture."""
        from relight.captures.capture import capture_files

        return capture_files(self.captures[figure])

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
        """Names of the figures, which are seeds, scans or captures."""
        first, count = self.cfg.figures.first, self.cfg.figures.count
        return [*self.scans, *self.captures] or [f"g{seed:04d}" for seed in range(first, first + count)]

    @cached_property
    def decades(self) -> list[str]:
        """Decades of generated figures that are completely in the plan, by the common prefix of their names: g012."""
        count = Counter(name[:-1] for name in self.figures) if not (self.scans or self.captures) else {}
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
        """Returns the ROW_GROUPS of a training; a row in `train.start` is replaced by the file of its network.

        Raises:
            UserError: as `composed`, or if the row changes a shared setting.
        """
        if training not in self._by_training:
            name = self.trainings[training]
            groups = self._row_settings(name.row)
            start = groups["train"]["start"]
            own_settings = {
                "seed": name.seed,
                "start": self.network(f"{start}.s{name.seed}") if start in self.rows else start,
            }
            self._by_training[training] = {**groups, "train": {**groups["train"], **own_settings}}
        return self._by_training[training]

    def _row_settings(self, row: str) -> dict[str, Any]:
        """Returns the ROW_GROUPS of a row as plain values. Raises UserError if they are invalid."""
        if row not in self._by_row:
            for word in (*self.overrides, *self.rows[row]):
                if word.lstrip("+").startswith("train.seed="):
                    raise UserError(f"{word}: give the seeds of all trainings, sweep.seeds=[{word.partition('=')[2]}]")
            cfg: Any = OmegaConf.to_container(composed([*self.overrides, *self.rows[row]]))
            split_kind = {"kind": cfg["split"]["kind"]}
            for group, shared in {**self.shared, "split": {**self.shared["split"], **split_kind}}.items():
                if (group not in ROW_GROUPS or group == "split") and cfg[group] != shared:
                    raise UserError(
                        f"row {row} changes {group}, which all rows share: change it for all, under a new name"
                    )
            if cfg["train"]["start"] == row:
                raise UserError(f"row {row}: train.start={row} is the row itself: name another row")
            self._by_row[row] = {group: cfg[group] for group in ROW_GROUPS}
        return self._by_row[row]

    def _cache_key(self, row: str) -> str:
        """Returns a hash of everything on which the settings of a row depend."""
        parts = [self._sources, json.dumps([row, self.overrides, list(self.rows[row])])]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    @cached_property
    def _sources(self) -> str:
        """A hash of the code and the files from which settings are composed."""
        digest = hashlib.sha256("\0".join(map(version, ("hydra-core", "omegaconf", "PyYAML"))).encode())
        for file in [Path(__file__), *sorted(Path(schema.__file__).parent.glob("*.py")), *sorted(CONF.rglob("*.yaml"))]:
            digest.update(f"\0{file.name}\0".encode() + file.read_bytes())
        return digest.hexdigest()

    @property
    def clone(self) -> str:
        """The machine and the folder of this clone."""
        return f"{platform.node()}:{ROOT}"

    def tracking(self) -> dict[str, Any]:
        """Returns what MLflow's runs of the trainings tell of the workflow (`relight.tracking.run.WORKFLOW`)."""
        commit, changes = (git(ROOT, *words) for words in (("rev-parse", "HEAD"), ("status", "--porcelain")))
        tags = {"workflow": self.cfg.name, "settings": shlex.join(self.overrides)[:MAX_TAG], "clone": self.clone}
        if commit:
            tags |= {"mlflow.source.git.commit": commit, "git.dirty": str(bool(changes)).lower()}
        experiments = {row: [name for name, e in self.experiments.items() if row in e.rows] for row in self.rows}
        by_row = {row: {**tags, "experiment": ", ".join(names)} for row, names in experiments.items()}
        return {"track": self.shared["track"], "tags": by_row}

    @property
    def networks(self) -> dict[str, str]:
        """The files of the networks that the tables compare, by training."""
        return {training: self.network(training) for training in self.scored}

    def network(self, training: str) -> str:
        """Returns the file of a trained network."""
        return f"{self.out}/train/{training}.safetensors"

    def start_network(self, training: str) -> list[str]:
        """Returns the network of this workflow from which a training starts, if any."""
        start = self.settings(training)["train"]["start"]
        return [start] if start in map(self.network, self.trainings) else []

    def split_kind(self, experiment: str) -> str:
        """Returns the split of an experiment's scores; rows with different splits must have the same test figures."""
        return self.settings(self.trainings_of(self.experiments[experiment].rows[0])[0])["split"]["kind"]

    def trainings_of(self, row: str) -> list[str]:
        """Returns the trainings of a row, one per seed."""
        return [training for training, name in self.trainings.items() if name.row == row]

    def scores(self, experiment: str, usual: bool = False) -> dict[str, list[str]]:
        """Returns the files of scores of an experiment's rows, and of its baselines under "".

        Args:
            experiment: name.
            usual: for the usual figures and lights instead of the experiment's own.
        """
        folder = "evaluate/" if usual else f"evaluate/{self.condition_folder(experiment)}"
        rows = self.experiments[experiment].rows
        files = {row: [f"{folder}{training}.csv" for training in self.trainings_of(row)] for row in rows}
        return {**files, "": [f"{folder}baselines.{self.split_kind(experiment)}.csv"]}

    @property
    def score_files(self) -> list[str]:
        """All files of scores that the report needs."""
        tables = [self.scores(name, usual) for name in self.tables for usual in (False, True)]
        files = (f"{self.out}/{path}" for rows in tables for paths in rows.values() for path in paths)
        return list(dict.fromkeys(files))

    @property
    def benchmark_index(self) -> Path:
        """The index of the benchmark's set. Raises UserError if there is no complete set."""
        from relight.benchmark.files import INDEX, BenchmarkSet

        benchmark = BenchmarkSet(self.cfg.benchmark.folder)
        benchmark.maps(benchmark.entries[0])
        return benchmark.folder / INDEX

    @cached_property
    def benchmark_weights(self) -> dict[str, str]:
        """The file of weights of each method that answers the benchmark, by the name of the training or the method.

        Baselines have those that ship with relight, since `mean_light` is the mean of their training lights.
        """
        from relight.benchmark.methods import FIXED
        from relight.photos.api import WEIGHTS

        trainings = [training for row in self.requested["benchmark"].rows for training in self.trainings_of(row)]
        return {training: self.network(training) for training in trainings} | dict.fromkeys(FIXED, str(WEIGHTS))

    def stage_outputs(self, experiment: str) -> list[str]:
        """Returns the files that the stages of an experiment without a table write for the report."""
        if experiment == "benchmark":
            return [f"{self.out}/benchmark_scores/{method}/scores.csv" for method in self.benchmark_weights]
        if experiment == "inference_time":
            return [
                f"{self.out}/{experiment}/{self.trainings_of(row)[0]}.csv" for row in self.requested[experiment].rows
            ]
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
            trained = [
                self.network(training)
                for row in experiment.rows
                for training in self.trainings_of(row)
                if name != "inference_time"
            ]
            scores = [path for usual in (False, True) for paths in self.scores(name, usual).values() for path in paths]
            files = [f"{self.out}/{path}" for path in scores] if experiment.table else self.stage_outputs(name)
            if absent := missing([*trained, *files]):
                lacking[name] = absent
        return {} if missing(shared) or len(lacking) == len(self.experiments) else lacking

    def settings_file(self, stage: str) -> str:
        """Returns the text of the settings file of a stage, in YAML: its settings, and the hash of its code.

        A stage in `pin` keeps the hash that its file has.

        Args:
            stage: `stage`, `stage.training` or `split.kind`.
        """
        full_name = stage
        stage, _, of = stage.partition(".")
        if stage == "split":
            tree = {**self.shared, "split": {**self.shared["split"], "kind": of}}
        elif of and of not in self.trainings:
            raise UserError(f"no training {of}; there are {', '.join(self.trainings)}")
        else:
            tree = self.settings(of) if of else self.shared
        settings = view(tree, stage)
        code = self.recorded(full_name).get("code") if stage in self.cfg.pin else None
        settings["code"] = code or code_hash(stage, words_of(settings))
        return HEAD + OmegaConf.to_yaml(settings)

    @property
    def map_names(self) -> list[str]:
        """The maps of all figures and their views."""
        return [name for figure in self.figures for name in self.maps(figure)]

    def config_text(self, file: str) -> str:
        """Returns the text of a file of results/<name>/config: a stage's settings, a list, or the experiments."""
        if file == "figures.txt":
            return "".join(f"{figure}\n" for figure in self.figures)
        if file == "maps.txt":
            return "".join(f"{name}\n" for name in self.map_names)
        return self.experiments_json() if file == "experiments.json" else self.settings_file(file.removesuffix(".yaml"))

    def update_config(self) -> None:
        """Writes the existing files of results/<name>/config that differ, so that what reads them is made again.

        Snakemake compares with its records, and has none of a folder that was copied or moved: there, dates decide.
        """
        for file in sorted((ROOT / self.out / "config").glob("*")):
            stage, _, of = file.stem.partition(".")
            if not (file.name in LISTS or (file.suffix == ".yaml" and self.is_read(stage, of))):
                continue
            if file.read_bytes() != (text := self.config_text(file.name).encode()):
                with atomic_write(file) as tmp:
                    tmp.write_bytes(text)

    def is_read(self, stage: str, of: str) -> bool:
        """Returns whether this plan has such a stage and, if one is given, the training `of`."""
        return stage in READS and (not of or stage == "split" or of in self.trainings)

    def recorded(self, stage: str) -> dict[str, Any]:
        """Returns the settings with which the results of a stage were made; empty if there is no such record."""
        try:
            recorded = yaml.safe_load((ROOT / self.out / "config" / f"{stage}.yaml").read_text(encoding="utf-8"))
        except (OSError, ValueError, yaml.YAMLError):
            return {}
        return recorded if isinstance(recorded, dict) else {}

    def changes(self) -> dict[str, list[str]]:
        """Returns what differs from the settings with which existing results were made.

        Returns:
            stage -> keys of settings, such as loss.albedo, and "code" for its code.
        """
        differing: dict[str, set[str]] = {}
        for file in sorted((ROOT / self.out / "config").glob("*.yaml")):
            stage, _, of = file.stem.partition(".")
            if self.is_read(stage, of):
                before, now = flat(self.recorded(file.stem)), flat(yaml.safe_load(self.settings_file(file.stem)))
                keys = {key for key in before.keys() | now.keys() if before.get(key) != now.get(key)}
                differing.setdefault(stage, set()).update(keys)
        save_cache()
        return {stage: sorted(keys) for stage, keys in differing.items() if keys}

    def experiments_json(self) -> str:
        """Returns the experiments as JSON, for the report.

        Each has its fields, and its `trainings` by row. Tables also have files in results/<name>: their
        `scores`, those on the `usual` figures and lights, and the `splits` of their rows. An experiment that is
        left out has its missing files in `failed`.
        """
        described = {}
        for name, experiment in self.requested.items():
            described[name] = {
                **asdict(experiment),
                "trainings": {row: self.trainings_of(row) for row in experiment.rows},
            }
            if name in self.failed:
                described[name] |= {"failed": self.failed[name]}
            elif experiment.table:
                kinds = {row: self.settings(self.trainings_of(row)[0])["split"]["kind"] for row in experiment.rows}
                splits = {row: f"split/{kind}.json" for row, kind in kinds.items()}
                described[name] |= {
                    "scores": self.scores(name),
                    "usual": self.scores(name, usual=True),
                    "splits": splits,
                }
        return json.dumps(described, indent=1)


def words_of(settings: Any) -> frozenset[str]:
    """Returns the keys and texts of a tree of settings."""
    if isinstance(settings, dict):
        return frozenset(settings).union(*map(words_of, settings.values()))
    if isinstance(settings, list):
        return frozenset().union(*map(words_of, settings))
    return frozenset({settings} if isinstance(settings, str) else ())


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
