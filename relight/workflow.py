"""What the Snakefile asks: the figures, the runs and the settings of a plan."""

import copy
import hashlib
import json
import shlex
import subprocess
import time
from collections import Counter
from dataclasses import asdict, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import yaml
from omegaconf import DictConfig, OmegaConf

from relight.config import ROOT, Experiment, Track, check_name, composed, view
from relight.files import UserError, atomic_write, remove_folder
from relight.track import Workflow, milliseconds

HEAD = """\
defaults: [schema, _self_, override hydra/job_logging: none, override hydra/hydra_logging: none]
hydra: {run: {dir: .}, output_subdir: null, job: {chdir: false}}
"""
USUAL = ("test", "test")  # the figures and lights of the tables
SHARED = ("figures", "clean", "align", "bake", "split", "panoramas", "lights", "evaluate")  # by all runs, but for KIND
KIND = ("split", "kind")
SKEW = 60  # seconds that the clock of a file server may be ahead


class Plan:
    """The settings of one invocation, composed once; those of a run of the sweep, when they are asked for.

    `config` is Snakemake's: `hydra` holds overrides (a list, or one string of words); `runs` (optional) replaces the
    sweep's runs, and all experiments but one table of them; `failed` (optional) maps experiments that are left out to
    their files that could not be made. Raises UserError in one line when a setting, a folder or a file is not as it
    must be.

    rows: what may be trained, name -> overrides; runs: rows x seeds; experiments: the sections of the report, each with
    those of its rows that `sweep.only` and the number of figures leave; scored: the runs that their tables need.
    """

    def __init__(self, config: dict):
        if strays := sorted(set(config) - {"hydra", "runs", "failed"}):
            word = f"{strays[0]}={config[strays[0]]}"
            raise UserError(f'--config {word}: write the settings as one word, --config hydra="{word}"')
        overrides = config.get("hydra") or []
        self.overrides = shlex.split(overrides) if isinstance(overrides, str) else list(overrides)
        self.cfg = composed(self.overrides)
        self.out = f"results/{self.cfg.name}"
        for row in config.get("runs") or ():
            check_name("runs", row)
        self.rows = config.get("runs") or OmegaConf.to_container(self.cfg.sweep.runs)
        self.runs = {f"{row}.s{seed}": (row, seed) for row in self.rows for seed in self.cfg.sweep.seeds}
        self.swept = "runs" in config
        self.asked = self._experiments()
        self.failed: dict[str, list[str]] = config.get("failed") or {}
        self.experiments = {name: one for name, one in self.asked.items() if name not in self.failed}
        if (self.cfg.evaluate.figures, self.cfg.evaluate.lights) != USUAL:
            raise UserError(
                "evaluate.figures and evaluate.lights are what an experiment says, such as experiment=sitting"
            )
        self.gpus = int(self.cfg.train.device == "cuda")  # what a training asks of a cluster
        self.composed: dict[str, DictConfig] = {}
        self.rows_composed: dict[str, DictConfig] = {}

    def look(self) -> None:
        """Looks at the user's folders and packages: what is wrong with them is told before anything runs."""
        given = [*(scan.path for scan in self.scans.values()), *self.table, *self.panoramas]
        latest = time.time() + SKEW
        for path in map(Path, given):  # Snakemake ends a job whose outputs are older than its inputs
            if path.exists() and path.stat().st_mtime > latest:
                raise UserError(f"{path} is dated in the future: correct this machine's clock, or `touch` the file")
        if "path_traced" in self.experiments and find_spec("mitsuba") is None:
            raise UserError("experiment=path_traced needs Mitsuba, which is not installed here: pip install mitsuba")

    def record(self, folder: Path | str) -> Path:
        """Writes what was asked for to run.yaml in the results of this repository; returns that path."""
        asked = {"hydra": self.overrides, **({"runs": self.rows} if self.swept else {})}
        file, text = Path(folder) / self.out / "run.yaml", yaml.safe_dump(json.loads(json.dumps(asked)))
        if not file.exists() or file.read_text() != text:
            with atomic_write(file) as tmp:
                tmp.write_text(text)
        return file

    def settle(self, made: set[str]) -> None:
        """Tidies up after a workflow that ended well: `made` are the files of all its jobs.

        A training's state goes here and not earlier: Snakemake deletes the outputs of a job that was killed before
        Snakemake could record them. A page of provenance that is older than the report tells of another one.
        """
        for network in filter(made.__contains__, map(self.network, self.runs)):
            remove_folder(Path(network).parent / "state" / Path(network).stem)
        report = Path(self.out, "report", "report.html")
        page = report.with_name("snakemake.html")
        if page.exists() and report.exists() and page.stat().st_mtime < report.stat().st_mtime:
            page.unlink()

    def _experiments(self) -> dict[str, Experiment]:
        wanted = set(self.cfg.sweep.only or self.rows)
        if unknown := wanted - set(self.rows):
            raise UserError(f"sweep.only: no run {min(unknown)}; there are {', '.join(self.rows)}")
        if self.swept:
            return {"sweep": Experiment(rows=list(self.rows), plates=True)}
        given = OmegaConf.to_object(self.cfg.experiments)
        found = {
            name: replace(e, rows=self._different([r for r in e.rows if r in wanted])) for name, e in given.items()
        }
        return {name: experiment for name, experiment in found.items() if experiment.rows}

    def _different(self, rows: list[str]) -> list[str]:
        """The rows without those that are another one again: that ask for all figures, or the width of the scale."""
        plain = {row: [word for word in self.rows[row] if not self._idle(word)] for row in rows}
        return [r for r in rows if plain[r] == self.rows[r] or all(plain[r] != self.rows[o] for o in rows)]

    def _idle(self, word: str) -> bool:
        """Whether an override asks for what is so without it."""
        key, _, value = word.partition("=")
        if key == "train.figures" and value.isdigit():
            return int(value) >= len(self.figures)
        return word == f"model.width={self.cfg.model.width}"

    @property
    def scored(self) -> list[str]:
        """The runs that the tables compare."""
        rows = {row for experiment in self.experiments.values() if experiment.table for row in experiment.rows}
        return [run for run, (row, _) in self.runs.items() if row in rows]

    def on(self, experiment: str) -> str:
        """The folder of an experiment's scores in evaluate/: "" for the usual figures and lights, or sitting-test/."""
        one = self.experiments[experiment]
        return "" if (one.figures, one.lights) == USUAL else f"{one.figures}-{one.lights}/"

    @cached_property
    def scans(self) -> dict:
        """The user's meshes by name; empty when figures are generated."""
        if self.cfg.figures.source == "generated":
            return {}
        from relight.meshes import list_scans

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
    def tens(self) -> list[str]:
        """The decades of generated figures that are whole in the plan, as the beginnings of their names: g012."""
        count = Counter(name[:-1] for name in self.figures) if not self.scans else {}
        return [name for name, found in count.items() if found == 10]

    @cached_property
    def alone(self) -> list[str]:
        """The figures outside of whole decades, each made by jobs of its own."""
        whole_decades = set(self.tens)
        return [name for name in self.figures if self.scans or name[:-1] not in whole_decades]

    def maps(self, figure: str) -> list[str]:
        """Names of the maps of a figure: the frontal view of its own outfit is called like the figure."""
        from relight.transport import outfit_names, view_names

        looks = outfit_names(figure, self.cfg.figures.outfits)
        return [name for look in looks for name in (look, *view_names(look, self.cfg.bake.views))]

    @cached_property
    def panoramas(self) -> list[str]:
        """Files of the user's panoramas; empty when rooms are generated."""
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

    def of_run(self, run: str) -> DictConfig:
        """The settings of one run of the sweep; where `train.start` names a run, the network of that, of one seed."""
        if run not in self.composed:
            row, seed = self.runs[run]
            cfg = copy.deepcopy(self._of_row(row))
            cfg.train.seed = seed
            if cfg.train.start in self.rows:
                cfg.train.start = self.network(f"{cfg.train.start}.s{seed}")
            self.composed[run] = cfg
        return self.composed[run]

    def tracked(self) -> Workflow:
        """What MLflow is told of this workflow.

        A sweep of -m has an experiment of its own there, so that its runs do not stand among those of the tables.
        """
        settings = OmegaConf.to_container(self.cfg)
        track = Track(**settings.pop("track"))
        settings["sweep"]["runs"] = {row: list(words) for row, words in self.rows.items()}
        if self.swept:
            track.experiment += " sweeps"
        rows = {row: [name for name, e in self.experiments.items() if row in e.rows] for row in self.rows}
        commit, changed = (git(*words) for words in (("rev-parse", "HEAD"), ("status", "--porcelain")))
        tags = {"workflow": self.cfg.name, "sweep": str(self.swept).lower()}
        if commit:
            tags |= {"mlflow.source.git.commit": commit, "git.dirty": str(bool(changed)).lower()}
        mark = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
        return Workflow(track, self.cfg.name, mark, settings, rows, tags, milliseconds())

    @property
    def networks(self) -> dict[str, str]:
        """The files of the networks that the tables compare, by run."""
        return {run: self.network(run) for run in self.scored}

    def _of_row(self, row: str) -> DictConfig:
        """The settings that the runs of a row have in common, composed once: that takes longer than all else here."""
        if row not in self.rows_composed:
            cfg = composed([*self.overrides, *self.rows[row]])
            for group in SHARED:
                if any(cfg[group][key] != value for key, value in self.cfg[group].items() if (group, key) != KIND):
                    raise UserError(
                        f"run {row} changes {group}, which all runs share: change it for all, under a new name"
                    )
            if cfg.train.start == row:
                raise UserError(f"run {row}: train.start={row} is the run itself")
            self.rows_composed[row] = cfg
        return self.rows_composed[row]

    def network(self, run: str) -> str:
        """The file of a trained network."""
        return f"{self.out}/train/{run}.safetensors"

    def start(self, run: str) -> list[str]:
        """The network of the sweep that a run goes on from."""
        start = self.of_run(run).train.start
        return [start] if start in map(self.network, self.runs) else []

    def kind(self, experiment: str) -> str:
        """The split that an experiment's rows are scored on; rows of several splits must share their test."""
        return self.of_run(self.of_row(self.experiments[experiment].rows[0])[0]).split.kind

    def of_row(self, row: str) -> list[str]:
        """The runs of a row, one per seed."""
        return [run for run, (own, _) in self.runs.items() if own == row]

    def scores(self, name: str, usual: bool = False) -> dict[str, list[str]]:
        """Files of the scores of an experiment's rows, and of its baselines under "": on its own figures and lights, or
        on the usual ones."""
        folder = "evaluate/" if usual else f"evaluate/{self.on(name)}"
        rows = {row: [f"{folder}{run}.csv" for run in self.of_row(row)] for row in self.experiments[name].rows}
        return {**rows, "": [f"{folder}baselines.{self.kind(name)}.csv"]}

    @property
    def score_files(self) -> list[str]:
        """All files of scores that the report needs."""
        found = [self.scores(name, usual) for name in self.tables for usual in (False, True)]
        files = (f"{self.out}/{path}" for rows in found for paths in rows.values() for path in paths)
        return list(dict.fromkeys(files))

    def own_files(self, name: str) -> list[str]:
        """What the stages of an experiment without a table write for the report."""
        if name == "inference_time":
            return [f"{self.out}/{name}/{self.of_row(row)[0]}.csv" for row in self.asked[name].rows]
        return [f"{self.out}/{name}/scores.csv", f"{self.out}/{name}/plate.png"]

    def failures(self, folder: Path | str) -> dict[str, list[str]]:
        """After a workflow that failed: experiment -> its files that are missing, in the repository `folder`.

        Empty when what all experiments share is missing, or none of them is complete: then there is nothing to report.
        """

        def missing(paths: list[str]) -> list[str]:
            return [path for path in dict.fromkeys(paths) if not Path(folder, path).exists()]

        shared = [f"{self.out}/{path}" for path in ("packed.safetensors", "figures.json", "lights/lights.npz")]
        found = {}
        for name, one in self.experiments.items():
            trained = [self.network(run) for row in one.rows for run in self.of_row(row) if name != "inference_time"]
            scores = [path for usual in (False, True) for paths in self.scores(name, usual).values() for path in paths]
            files = [f"{self.out}/{path}" for path in scores] if one.table else self.own_files(name)
            if lost := missing([*trained, *files]):
                found[name] = lost
        return {} if missing(shared) or len(found) == len(self.experiments) else found

    def settings(self, stage: str) -> str:
        """The YAML file that `stage`, `stage.run` or `split.kind` reads."""
        stage, _, run = stage.partition(".")
        if stage == "split":
            return HEAD + OmegaConf.to_yaml(
                OmegaConf.create(view(composed([*self.overrides, f"split.kind={run}"]), stage))
            )
        if run and run not in self.runs:
            raise UserError(f"no run {run}; there are {', '.join(self.runs)}")
        return HEAD + OmegaConf.to_yaml(OmegaConf.create(view(self.of_run(run) if run else self.cfg, stage)))

    def questions(self) -> str:
        """The experiments as JSON: the fields of each; its `runs` by row; for tables the files in results/<name> of its
        `scores`, on its own figures and lights and on the `usual` ones, and of the `splits` of its rows; of those that
        are left out, what `failed`."""
        made = {}
        for name, one in self.asked.items():
            made[name] = {**asdict(one), "runs": {row: self.of_row(row) for row in one.rows}}
            if name in self.failed:
                made[name] |= {"failed": self.failed[name]}
            elif one.table:
                splits = {row: f"split/{self.of_run(self.of_row(row)[0]).split.kind}.json" for row in one.rows}
                made[name] |= {"scores": self.scores(name), "usual": self.scores(name, usual=True), "splits": splits}
        return json.dumps(made, indent=1)


def git(*words: str) -> str:
    """What git says of this repository; nothing where there is no git or no repository."""
    try:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    except OSError:
        return ""
