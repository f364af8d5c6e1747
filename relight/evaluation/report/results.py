"""What a run of the workflow left in its folder, as the sections of its report ask for it."""

import json
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from relight import config
from relight.evaluation.scores import Scores
from relight.evaluation.statistics import Estimate, estimate, resample_weights
from relight.evaluation.tables import Table, experiment_table, gather, spread_of_trainings, titled, values


class Results:
    """The folder results/<name>, and the experiments that were asked for (experiments.json, `Plan.asked`).

    Of a table's methods, `usual` asks for the usual figures and lights in the place of the experiment's own.
    """

    def __init__(self, folder: Path, settings: config.Evaluate, experiments: Path):
        self.folder, self.settings = folder, settings
        self.experiments: dict[str, dict[str, Any]] = json.loads(experiments.read_text())
        self._tables: dict[tuple[str, bool], Table] = {}

    @property
    def report(self) -> Path:
        return self.folder / "report"

    @property
    def tables(self) -> list[str]:
        """The experiments that are tables of trainings."""
        return [name for name, one in self.experiments.items() if one["table"]]

    @cached_property
    def runs(self) -> list[str]:
        """The trainings that the tables compare."""
        found = (run for name in self.tables for runs in self.experiments[name]["runs"].values() for run in runs)
        return list(dict.fromkeys(found))

    @cached_property
    def record(self) -> dict[str, Any]:
        """figures.json: `figures`, what is known of each, and `left_out`, why some are not in the set."""
        return json.loads((self.folder / "figures.json").read_text())

    def usual(self, name: str) -> bool:
        """Whether an experiment is about the usual test figures and lights."""
        one = self.experiments[name]
        return one["figures"] == one["lights"] == "test"

    def scores(self, name: str, usual: bool = False) -> dict[str, list[Scores]]:
        """Scores by row, one per training; {} where there was nothing to score."""
        files = self._files(name, usual)
        found = gather([self.folder / path for row, paths in files.items() if row for path in paths])
        return {row: found[row] for row in files if row in found}

    def baselines(self, name: str, usual: bool = False) -> dict[str, list[Scores]]:
        return gather([self.folder / path for path in self._files(name, usual)[""]])

    def table(self, name: str, usual: bool = False) -> Table:
        """The table of an experiment; how much trainings spread is told by all tables on the same pairs."""
        if (name, usual) not in self._tables:
            self._tables[name, usual] = self._table(name, usual)
        return self._tables[name, usual]

    def _table(self, name: str, usual: bool) -> Table:
        rows, pool = self.scores(name, usual), {}
        if not rows:
            return Table(*titled(name), [], 0, 0)
        for other in self.tables:
            for condition in (False, True):
                if self._files(other, condition)[""] == self._files(name, usual)[""]:
                    pool |= self.scores(other, condition)
        return experiment_table(name, rows, self.baselines(name, usual), self.settings, pool)

    def estimates(self, name: str, column: str) -> dict[str, Estimate]:
        """Row, or baseline, -> mean and interval of any column of the scores, in a table or not."""
        rows, baselines = self.scores(name), self.baselines(name)
        if not rows:
            return {}
        figures, seed = len(next(iter(rows.values()))[0].figures), self.settings.seed
        weights = resample_weights(figures, self.settings.bootstrap, seed)
        spread = spread_of_trainings(rows, (column,))[column]
        return {
            row: estimate(values(trainings, column), weights, seed + place, spread if row in rows else None)
            for place, (row, trainings) in enumerate({**rows, **baselines}.items())
            if all(column in scores.columns for scores in trainings)
        }

    def split(self, name: str, row: str) -> dict[str, list[str]]:
        """The figures that a row was trained and scored on, by part."""
        return json.loads((self.folder / self.experiments[name]["splits"][row]).read_text())

    def setting(self, row: str, key: str) -> Any:
        """A setting, such as `model.width`, that a row was trained with."""
        run = next(one["runs"][row][0] for one in self.experiments.values() if row in one["runs"])
        value = yaml.safe_load((self.folder / "config" / f"train.{run}.yaml").read_text())
        for part in key.split("."):
            value = value[part]
        return value

    def _files(self, name: str, usual: bool) -> dict[str, list[str]]:
        return self.experiments[name]["usual" if usual else "scores"]
