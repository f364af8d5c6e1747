"""Reads catalogues: sections of YAML files in this folder, whose entries must fit a type, such as a dataclass."""

from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import yaml

from relight.core.errors import UserError
from relight.core.text import read_text

T = TypeVar("T")
FOLDER = Path(__file__).parent


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """PyYAML's loader, which refuses keys that a mapping has twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict:
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
    return {key: converted(value, kind, f"{path}: {section}: {key}", key) for key, value in table.items()}


def converted(value: Any, kind: Any, where: str, name: str | None = None) -> Any:
    """Returns a value of YAML as a value of a type of Python.

    Args:
        value: as YAML gives it: a list for a tuple, a mapping for a dataclass.
        kind: a dataclass, tuple, dictionary, choice (Literal), optional or plain type.
        where: file, section and key of the value, which begin error messages.
        name: the value's key, for the field `name` of a dataclass.

    Raises:
        UserError: if the value does not fit.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        return _as_dataclass(value, kind, where, name)
    if origin is UnionType:
        return (
            None if value is None else converted(value, next(part for part in arguments if part is not NoneType), where)
        )
    if origin is tuple:
        if not isinstance(value, list) or (arguments[-1] is not ... and len(value) != len(arguments)):
            count = "" if arguments[-1] is ... else f" of {len(arguments)}"
            raise UserError(f"{where} must be a list{count}, not {value!r}")
        kinds = arguments[:1] * len(value) if arguments[-1] is ... else arguments
        return tuple(converted(item, part, where) for item, part in zip(value, kinds))
    if origin is dict and isinstance(value, dict):
        return {key: converted(item, arguments[1], f"{where}: {key}") for key, item in value.items()}
    if origin is Literal:
        if value not in arguments:
            raise UserError(f"{where} must be one of {', '.join(map(str, arguments))}, not {value!r}")
        return value
    words = {float: "a number", int: "an integer", bool: "true or false", str: "a text"}.get(kind, "a mapping")
    numbers = (int, float) if kind is float else kind
    if words == "a mapping" or not isinstance(value, numbers) or (kind is not bool and isinstance(value, bool)):
        raise UserError(f"{where} must be {words}, not {value!r}")
    return kind(value)


def _as_dataclass(value: Any, kind: Any, where: str, name: str | None) -> Any:
    """Returns a mapping of YAML as an object of a dataclass; raises UserError, with `where` first, if it does not fit.

    `name` is for the field of that name, if the dataclass has one.
    """
    if not isinstance(value, dict):
        raise UserError(f"{where} must be a mapping, not {value!r}")
    hints = get_type_hints(kind)
    settable = {field.name: field for field in fields(kind) if field.name != "name"}
    for key in value:
        if key not in settable:
            raise UserError(f"{where}: {key} is not a field of {kind.__name__}, which has {', '.join(settable)}")
    for key, field in settable.items():
        if key not in value and field.default is MISSING and field.default_factory is MISSING:
            raise UserError(f"{where} needs {key}")
    chosen = {key: converted(item, hints[key], f"{where}: {key}") for key, item in value.items()}
    try:
        return kind(**chosen, **({"name": name} if "name" in hints else {}))
    except ValueError as error:
        raise UserError(f"{where}: {error}") from None
