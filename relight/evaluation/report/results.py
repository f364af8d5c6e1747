"""Reads the results of a run of the workflow for its report."""

import json
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from relight.core.files import existing_file
from relight.evaluation.scoring.scores import gather
from relight.evaluation.scoring.tables import Rows, Table, experiment_table
from relight.learning.checkpoint import read_config
from relight.settings.scores import columns_of, label


class Results:
    """The folder results/<name>, and the experiments of the run.

    The argument `usual` of a method selects the usual test figures and lights instead of the experiment's own.

    Attributes:
        folder: results/<name>.
        data: that of the figures and lights.
        experiments: name -> fields of `relight.settings.Experiment`, `trainings` and files
            (`relight.lab.plan.Plan.described`).
    """

    def __init__(self, folder: Path, experiments: dict[str, dict[str, Any]], data: Path):
        self.folder, self.experiments, self.data = folder, experiments, data
        self._tables: dict[tuple[str, bool], Table] = {}
        self._scores: dict[tuple[str, ...], Rows] = {}

    @property
    def report(self) -> Path:
        """The folder of the page."""
        return self.folder / "report"

    @property
    def tables(self) -> list[str]:
        """The experiments that did not fail."""
        return [name for name, told in self.experiments.items() if not told.get("failed")]

    @property
    def trainings(self) -> list[str]:
        """The trainings that the tables compare, by row."""
        own = [self.experiments[name]["trainings"] for name in self.tables]
        return list(dict.fromkeys(training for rows in own for row in rows.values() for training in row))

    def title(self, name: str) -> str:
        """Returns the title of an experiment, which is its name if it has none."""
        return self.experiments[name]["title"] or name

    @cached_property
    def record(self) -> dict[str, Any]:
        """figures.json: `figures`, the record of each, and `left_out`, the reasons why some are not in the set."""
        return self.json("figures.json")

    @cached_property
    def lights(self) -> dict[str, Any]:
        """chain.json: the lights before and after each step of the light chain, with reasons."""
        return self.json("lights/chain.json")

    def json(self, path: str) -> dict[str, Any]:
        """Reads a .json file of the data. Raises UserError if it is missing."""
        return json.loads(existing_file(self.data / path, "results").read_text())

    def usual(self, name: str) -> bool:
        """Returns whether an experiment has the usual test figures and lights."""
        experiment = self.experiments[name]
        return experiment["figures"] == experiment["lights"] == "test"

    def scores(self, name: str, usual: bool = False) -> Rows:
        """Returns the scores of each row, one per training; empty if the data set has no such figures or lights."""
        files = self._files(name, usual)
        rows = self.gather(path for row, paths in files.items() if row for path in paths)
        return {row: rows[row] for row in files if row in rows}

    def table(self, name: str, usual: bool = False) -> Table:
        """Returns the table of an experiment; the spread of trainings is pooled over all tables on the same pairs."""
        if (name, usual) not in self._tables:
            table = self._tables[name, usual] = self._table(name, usual)
            table.labels = {row: label(row, self.experiments.values()) for row in table.rows}
        return self._tables[name, usual]

    def _table(self, name: str, usual: bool) -> Table:
        """Computes the table of an experiment; it has no rows if the data set has no such figures or lights."""
        rows, columns = self.scores(name, usual), columns_of(*self.experiments[name]["shows"])
        baselines = self._files(name, usual)[""]
        if not rows:
            return Table(columns)
        pool: Rows = {}
        for other in dict.fromkeys([name, *self.tables]):
            for condition in (False, True):
                if self._files(other, condition)[""] == baselines:  # the same pairs
                    pool |= self.scores(other, condition)
        return experiment_table(name, rows, self.gather(baselines), columns, pool)

    @cached_property
    def run(self) -> dict[str, Any]:
        """run.yaml: `overrides` as given, the `settings` that all rows share, and those of `rows`."""
        return yaml.safe_load((self.folder / "run.yaml").read_text(encoding="utf-8"))

    def recipe(self, training: str) -> dict[str, Any]:
        """Returns the settings in the file of a network."""
        return read_config(self.folder / "train" / f"{training}.safetensors")

    def gather(self, paths: Iterable[str]) -> Rows:
        """Reads the scores in files of the results, by person, each set of files once."""
        if (files := tuple(paths)) not in self._scores:
            subjects = {name: figure.get("subject", name) for name, figure in self.record["figures"].items()}
            found = gather([self.folder / path for path in files])
            self._scores[files] = {row: [one.by_subject(subjects) for one in rows] for row, rows in found.items()}
        return self._scores[files]

    def _files(self, name: str, usual: bool) -> dict[str, list[str]]:
        """Returns the files of an experiment's scores: row -> one per training; "" -> the file of the baselines."""
        return self.experiments[name]["usual" if usual else "scores"]
