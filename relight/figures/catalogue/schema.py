"""Reads catalogues: sections of YAML files in this folder, whose entries must fit a type, such as a dataclass."""

import json
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError

from relight.core.errors import UserError
from relight.core.text import read_text

T = TypeVar("T")
FOLDER = Path(__file__).parent


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """PyYAML's loader, which refuses keys that a mapping has twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Returns a mapping; a key beside a merged mapping (<<) replaces the merged one.

        Raises:
            UserError: if a key is given twice.
        """
        keys: set[str] = set()
        for key, _ in node.value:
            if key.value in keys and not getattr(node, "merged", False):
                raise UserError(f"{key.value} is given twice, the second time{key.start_mark}")
            keys.add(key.value)
        node.merged = True  # PyYAML constructs a mapping again, with the merged keys before its own
        return super().construct_mapping(node, deep)


@cache
def contents(path: Path) -> dict[str, Any]:
    """Returns the contents of a catalogue: sections by name. A file is read once per process.

    Raises:
        UserError: if the file is not valid YAML.
    """
    try:
        return yaml.load(read_text(path), Loader)
    except (yaml.YAMLError, ValueError, UserError) as error:
        raise UserError(f"{path}: {' '.join(str(error).split())}") from None


@cache
def entries(name: str, section: str, kind: type[T], folder: Path = FOLDER) -> dict[str, T]:
    """Returns the entries of a section of a catalogue, by name, in the order of the file.

    Args:
        name: name of the file, without its suffix.
        section: section of the file.
        kind: type of the entries. If it is a dataclass with a field `name`, that is the name of the entry.
        folder: folder of the file.

    Raises:
        UserError: for a missing section, and for an entry that does not fit `kind`.
    """
    path = folder / f"{name}.yaml"
    table = (contents(path) or {}).get(section)
    if not isinstance(table, dict):
        raise UserError(f"{path} needs a section {section} with entries")
    if "name" in getattr(kind, "__dataclass_fields__", ()):
        table = {key: {**value, "name": key} if isinstance(value, dict) else value for key, value in table.items()}
    adapter = TypeAdapter(dict[str, kind], config=ConfigDict(extra="forbid"))  # type: ignore[valid-type]
    try:
        return adapter.validate_json(json.dumps(table), strict=True)  # of JSON, lists may be tuples
    except ValidationError as error:
        first = error.errors()[0]
        where = ": ".join(map(str, first["loc"]))
        raise UserError(f"{path}: {section}: {where}: {first['msg']}") from None
