"""Composes and checks the settings of rows: the named sets of overrides that a workflow trains."""

import hashlib
import json
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from relight import config
from relight.config import CONF, ROOT, composed
from relight.errors import UserError
from relight.files import atomic_write

# The groups that rows may change; of the split only its kind.
ROW_GROUPS = ("model", "loss", "train", "augment", "split", "track")
CACHE = Path(".snakemake", "relight.settings.json")  # settings of rows, by the hash of their sources
COMPOSERS = ("hydra-core", "omegaconf", "PyYAML")  # packages whose versions may change what is composed


class RowSettings:
    """The settings of the rows of a workflow. Each row is composed once, when it is first asked for."""

    def __init__(self, overrides: list[str], rows: dict[str, list[str]], shared: dict[str, Any]):
        """Takes what the settings are composed from; composes nothing yet.

        Args:
            overrides: of the whole workflow, in the syntax of Hydra.
            rows: name -> its own overrides, which follow those of the workflow.
            shared: the settings that `overrides` give, as plain values by group.
        """
        self.overrides, self.rows, self.shared = overrides, rows, shared
        self._composed: dict[str, dict[str, Any]] = {}

    def of(self, row: str) -> dict[str, Any]:
        """Returns the ROW_GROUPS of a row as plain values by group.

        Raises:
            UserError: if a setting is invalid, or the row changes one that all rows share.
        """
        if row not in self._composed:
            self._composed[row] = self._compose(row)
        return self._composed[row]

    def compose_all(self) -> None:
        """Composes and checks all rows, which takes seconds, or reads them from the cache of an earlier process.

        Raises:
            UserError: if the settings of a row are invalid (`of`).
        """
        keys = {row: self._cache_key(row) for row in self.rows}
        try:
            cached = json.loads((ROOT / CACHE).read_text())
        except (OSError, ValueError):
            cached = {}
        for row, key in keys.items():
            if isinstance(settings := cached.get(key), dict):
                self._composed[row] = settings
            self.of(row)
        if not set(keys.values()) <= set(cached) and (ROOT / CACHE).parent.is_dir():
            try:
                with atomic_write(ROOT / CACHE) as tmp:
                    tmp.write_text(json.dumps({key: self._composed[row] for row, key in keys.items()}))
            except UserError:  # a read-only folder: settings are composed again next time
                pass

    def _compose(self, row: str) -> dict[str, Any]:
        """Composes and checks the ROW_GROUPS of a row; see `of`."""
        overrides = [*self.overrides, *self.rows[row]]
        for override in overrides:
            if override.lstrip("+").startswith("train.seed="):
                seed = override.partition("=")[2]
                raise UserError(f"{override}: give the seeds of all trainings, sweep.seeds=[{seed}]")
        settings: Any = OmegaConf.to_container(composed(overrides))
        may_differ = {group: settings[group] for group in ROW_GROUPS if group != "split"}
        may_differ["split"] = {**self.shared["split"], "kind": settings["split"]["kind"]}
        for group, expected in {**self.shared, **may_differ}.items():
            if settings[group] != expected:
                raise UserError(f"row {row} changes {group}, which all rows share: change it for all, under a new name")
        if settings["train"]["start"] == row:
            raise UserError(f"row {row}: train.start={row} is the row itself: name another row")
        return {group: settings[group] for group in ROW_GROUPS}

    def _cache_key(self, row: str) -> str:
        """Returns a hash of everything on which the settings of a row depend."""
        parts = [self._sources, json.dumps([row, self.overrides, list(self.rows[row])])]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    @cached_property
    def _sources(self) -> str:
        """A hash of the code, the files and the packages by which settings are composed."""
        code = [Path(__file__), *sorted(Path(config.__file__).parent.glob("*.py"))]
        digest = hashlib.sha256("\0".join(map(version, COMPOSERS)).encode())
        for file in [*code, *sorted(CONF.rglob("*.yaml"))]:
            digest.update(f"\0{file.name}\0".encode() + file.read_bytes())
        return digest.hexdigest()
