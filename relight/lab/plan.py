"""Plans a workflow for the Snakefile: names of figures, trainings and experiments, and the files of each."""

import platform
import shlex
from collections.abc import Iterable
from dataclasses import asdict, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

import yaml

from relight.core.errors import UserError
from relight.core.files import is_unsafe_name, write_text
from relight.core.processes import git
from relight.core.text import without_passwords
from relight.lab.made import is_made
from relight.lab.record import Record
from relight.learning.training_name import TrainingName
from relight.meshes.scans import TABLE, Scan, list_scans
from relight.settings import ROOT, Experiment
from relight.settings.scores import label

BATCH = 10  # generated figures that share a process, since one takes as long to start as to draw a figure
DATA = ("packed.safetensors", "lights/lights.npz")  # what other runs take of a run
MAX_TAG = 5000  # characters of a tag in MLflow


class Plan:
    """The plan of one workflow.

    A *row* is a named set of overrides, that is, of one row of the tables. A *training* is a row with a seed.

    Attributes:
        record: the composed settings (`relight.lab.record.compose_run`).
        shared: the settings that all rows share, as plain values by group.
        out: the folder of the results, relative to the working directory.
        data: the folder of the figures and lights, which is `out` or that of another run.
        trainings: name -> TrainingName, for all rows and seeds.
        requested: name -> experiment, with the rows that are selected.
        failed: experiments to leave out -> their missing files.
        experiments: the requested ones that did not fail.
    """

    def __init__(self, record: Record):
        """Plans a run.

        Raises:
            UserError: if `sweep.only` names a row that is unknown, or in no experiment.
        """
        self.record = record
        self.shared: dict[str, Any] = record["settings"]
        self.out = f"results/{self.shared['name']}"
        self.data = f"results/{self.shared['data'] or self.shared['name']}"
        self.rows: dict[str, list[str]] = self.shared["sweep"]["rows"]
        names = [TrainingName(row, seed) for row in self.rows for seed in self.shared["sweep"]["seeds"]]
        self.trainings = {str(name): name for name in names}
        self.requested = self._requested()
        self.failed: dict[str, list[str]] = record.get("failed", {})
        self.experiments = {name: experiment for name, experiment in self.requested.items() if name not in self.failed}
        self.gpus = int(self.shared["train"]["device"] == "cuda")  # requested by each training on a cluster

    def _requested(self) -> dict[str, Experiment]:
        """Returns the experiments by name with the rows to train; see the attribute `requested`."""
        selected = set(self.shared["sweep"]["only"] or self.rows)
        if unknown := selected - set(self.rows):
            raise UserError(f"sweep.only: no row {min(unknown)}; there are {', '.join(self.rows)}")
        experiments = {}
        for name, fields in self.shared["experiments"].items():
            experiment = Experiment(**fields)
            if rows := [row for row in experiment.rows if row in selected]:
                experiments[name] = replace(experiment, rows=rows)
        apart = selected - {row for fields in self.shared["experiments"].values() for row in fields["rows"]}
        if apart and self.shared["sweep"]["only"]:
            row = min(apart)
            advice = f'"++experiments={{{row}: {{rows: [{row}]}}}}"'
            raise UserError(f"sweep.only: {row} is in no experiment: {advice} makes one of it")
        return experiments

    # Figures and lights

    @cached_property
    def scans(self) -> dict[str, Scan]:
        """The user's meshes by name; empty for other sources."""
        figures = self.shared["figures"]
        return list_scans(figures["folder"]) if figures["source"] == "scans" else {}

    @property
    def table(self) -> list[str]:
        """The table of the scans, if the user's folder has one."""
        table = Path(self.shared["figures"]["folder"] or "") / TABLE
        return [str(table)] if self.scans and table.is_file() else []

    @cached_property
    def batches(self) -> dict[str, list[str]]:
        """The figures by batch: each scan is one, and the generated figures of each ten, such as g0010-g0019."""
        if self.scans:
            return {name: [name] for name in self.scans}
        first, count = self.shared["figures"]["first"], self.shared["figures"]["count"]
        tens = groupby(range(first, first + count), lambda seed: seed - seed % BATCH)
        return {f"g{ten:04d}-g{ten + BATCH - 1:04d}": [f"g{seed:04d}" for seed in seeds] for ten, seeds in tens}

    @cached_property
    def figures(self) -> list[str]:
        """Names of the figures, which are seeds or scans."""
        return [name for names in self.batches.values() for name in names]

    def maps(self, figure: str) -> list[str]:
        """Returns the names of the maps of a figure; the frontal view of its first outfit has the figure's name."""
        from relight.transport import outfit_names, view_names

        outfits = outfit_names(figure, self.shared["figures"]["outfits"])
        return [name for outfit in outfits for name in (outfit, *view_names(outfit, self.shared["bake"]["views"]))]

    @property
    def map_names(self) -> list[list[str]]:
        """The maps of all figures and their views by batch, in the order of the packed set."""
        return [[name for figure in figures for name in self.maps(figure)] for figures in self.batches.values()]

    @property
    def panoramas(self) -> list[str]:
        """The user's panoramas; empty for generated rooms."""
        if self.shared["panoramas"]["source"] != "folder":
            return []
        from relight.panoramas import list_panoramas

        folder = self.shared["panoramas"]["folder"]
        return safe(f"{folder}/{name}" for name in list_panoramas(folder))

    # Trainings

    def settings(self, training: str) -> dict[str, Any]:
        """Returns the settings of a training by group: those of its row, with its seed, without the device."""
        name = self.trainings[training]
        groups = self.record["rows"][name.row]
        train = {key: value for key, value in groups["train"].items() if key != "device"}
        return {**groups, "train": {**train, "seed": name.seed}}

    def device(self, training: str) -> str:
        """Returns the setting `train.device` of a training, which does not decide its result."""
        return str(self.record["rows"][self.trainings[training].row]["train"]["device"])

    def start(self, training: str) -> list[str]:
        """Returns the file that a training starts from, if any; for a row, its network with the same seed."""
        name = self.trainings[training]
        start = self.record["rows"][name.row]["train"]["start"]
        return [self.network(f"{start}.s{name.seed}") if start in self.rows else start] if start else []

    def network(self, training: str) -> str:
        """Returns the file of a trained network."""
        return f"{self.out}/train/{training}.safetensors"

    def trainings_of(self, row: str) -> list[str]:
        """Returns the trainings of a row, one per seed."""
        return [training for training, name in self.trainings.items() if name.row == row]

    def first_trainings(self, experiment: str) -> dict[str, str]:
        """Returns the first training of each row of an experiment, by row."""
        return {row: self.trainings_of(row)[0] for row in self.experiments[experiment].rows}

    def tracking(self) -> dict[str, Any]:
        """Returns what MLflow records of the workflow: the settings of `track`, `tags`, and the overrides of `rows`."""
        settings = without_passwords(shlex.join(self.record["overrides"]))[:MAX_TAG]
        tags = {"workflow": self.shared["name"], "experiment": ", ".join(self.experiments), "settings": settings}
        tags["clone"] = f"{platform.node()}:{ROOT}"
        if commit := git(ROOT, "rev-parse", "HEAD"):
            is_dirty = bool(git(ROOT, "status", "--porcelain"))
            tags |= {"mlflow.source.git.commit": commit, "git.dirty": str(is_dirty).lower()}
        return {"track": self.shared["track"], "tags": tags, "rows": self.rows}

    # Experiments

    @property
    def scored(self) -> list[str]:
        """The trainings that the tables compare."""
        rows = {row for experiment in self.experiments.values() for row in experiment.rows}
        return [training for training, name in self.trainings.items() if name.row in rows]

    def labels(self, rows: Iterable[str]) -> list[str]:
        """Returns the labels of rows."""
        experiments = list(map(asdict, self.requested.values()))
        return [label(row, experiments) for row in rows]

    def condition(self, experiment: str) -> str:
        """Returns the folder of an experiment's scores in evaluate/: "" for the usual pairs, or "sitting-test/"."""
        figures, lights = self.experiments[experiment].figures, self.experiments[experiment].lights
        return "" if figures == lights == "test" else f"{figures}-{lights}/"

    def scores(self, experiment: str, usual: bool = False) -> dict[str, list[str]]:
        """Returns the files of an experiment's scores by row, relative to `out`; those of "" are of the baselines.

        `usual`: on the usual figures and lights instead of the experiment's own.
        """
        folder = "evaluate/" if usual else f"evaluate/{self.condition(experiment)}"
        rows = self.experiments[experiment].rows
        files = {row: [f"{folder}{training}.csv" for training in self.trainings_of(row)] for row in rows}
        return {**files, "": [f"{folder}baselines.csv"]}

    def results_of(self, experiment: str) -> list[str]:
        """Returns the files of an experiment that the report needs: its scores."""
        scores = [*self.scores(experiment).values(), *self.scores(experiment, usual=True).values()]
        return list(dict.fromkeys(f"{self.out}/{path}" for paths in scores for path in paths))

    def described(self) -> dict[str, dict[str, Any]]:
        """Returns the experiments for the report.

        Each has its fields, its `trainings` by row, and files in results/<name>: its `scores`, and those on the `usual`
        figures and lights. An experiment that is left out has its missing files in `failed` instead.
        """
        described = {}
        for name, experiment in self.requested.items():
            trainings = {row: self.trainings_of(row) for row in experiment.rows}
            described[name] = {**asdict(experiment), "trainings": trainings}
            if name in self.failed:
                described[name]["failed"] = self.failed[name]
            else:
                described[name] |= {"scores": self.scores(name), "usual": self.scores(name, usual=True)}
        return described

    def missing_results(self) -> dict[str, list[str]]:
        """Returns the files that experiments lack after a workflow that failed, or that are left of an older one.

        Empty if no experiment is complete, since then there is nothing to report.
        """
        lacking = {}
        for name, experiment in self.experiments.items():
            networks = [self.network(training) for row in experiment.rows for training in self.trainings_of(row)]
            lacking[name] = [path for path in (*networks, *self.results_of(name)) if not is_made(path)]
        return {} if all(lacking.values()) else {name: paths for name, paths in lacking.items() if paths}

    def write_record(self, folder: str = "") -> Path:
        """Writes the record to run.yaml in a folder, by default that of the results, and returns the file."""
        file = Path(folder or self.out, "run.yaml")
        write_text(file, yaml.safe_dump(self.record, sort_keys=False))
        return file


def safe(paths: Iterable[Path | str]) -> list[str]:
    """Returns the user's files as inputs of rules, without those whose names are unsafe, which the jobs report."""
    return [str(path) for path in paths if not is_unsafe_name(path)]
