"""A setting: its description, its domain, and its field in the schema."""

from collections.abc import Mapping
from dataclasses import Field, dataclass, field
from types import UnionType
from typing import Any, get_args, get_origin

from omegaconf import MISSING

TYPE_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
LIST_WORDS = {int: "whole numbers", float: "numbers", str: "texts"}


@dataclass(frozen=True)
class Setting:
    """The description and the domain of a setting. For a list, the domain is that of each item.

    Attributes:
        about: description, with the unit.
        choices: the texts allowed; empty if all are.
        least, most: inclusive bounds of a number.
        above, below: exclusive bounds of a number.
        multiple: divisor of a number.
        interval: whether it is a list [least, most] of two numbers.
        supervised: whether it is the weight of a loss that needs ground truth.
        teaches: what such a loss constrains: "albedo", "transport" (or normals and AO), "light".
        kind: of generated panoramas (`relight.lights.load.GENERATED`) that it is the number of: "sky".
        unread: value of the `source` of its group under which it has no effect, so that nobody may give it: "scans".
    """

    about: str
    choices: tuple[str, ...] = ()
    least: float | None = None
    above: float | None = None
    most: float | None = None
    below: float | None = None
    multiple: int | None = None
    interval: bool = False
    supervised: bool = False
    teaches: tuple[str, ...] = ()
    kind: str = ""
    unread: str = ""

    @property
    def domain(self) -> str:
        """The domain of the setting or its items, in words that follow "must be"; empty if there are no limits."""
        words = [f"one of {', '.join(self.choices)}"] if self.choices else []
        words += [f"a multiple of {self.multiple}"] if self.multiple else []
        low = self.least if self.above is None else self.above
        high = self.most if self.below is None else self.below
        if low is not None and high is not None:
            words.append(f"in {'[' if self.above is None else '('}{low}, {high}{']' if self.below is None else ')'}")
        elif low is not None:
            words.append(f"at least {low}" if self.above is None else f"greater than {low}")
        elif high is not None:
            words.append(f"at most {high}" if self.below is None else f"less than {high}")
        return " and ".join(words)

    def allows(self, value: Any) -> bool:
        """Returns whether a value of the right type is allowed; OmegaConf decides about None."""
        if value is None or not (self.domain or self.interval):
            return True
        if isinstance(value, str | int | float):
            return self._allows_item(value)
        if isinstance(value, Mapping):
            return all(map(self._allows_item, value.values()))
        ordered = len(value) == 2 and value[0] <= value[1] if self.interval else len(value) > 0
        return ordered and all(map(self._allows_item, value))

    def _allows_item(self, value: Any) -> bool:
        """Returns whether a single value, or an item of a list, is one of `choices` and within the bounds."""
        return (
            (not self.choices or value in self.choices)
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
            and (self.multiple is None or value % self.multiple == 0)
        )


def setting(about: str, default: Any = MISSING, **rules: Any) -> Any:
    """Returns a field of the schema.

    Args:
        about: description, with the unit.
        default: only for settings that files may omit: weights of losses, and settings that are newer than files.
        **rules: the domain, as in `Setting`.
    """
    metadata = {"setting": Setting(about, **rules)}
    if isinstance(default, list | dict):
        return field(default_factory=default.copy, metadata=metadata)
    return field(default=default, metadata=metadata)


def setting_of(item: Field[Any]) -> Setting:
    """Returns the Setting of a field."""
    return item.metadata["setting"]


def domain_in_words(item: Field[Any]) -> str:
    """Returns the domain of a field in words that follow "must be"; empty if there are no limits."""
    described = setting_of(item)
    if described.interval:
        return f"[least, most]{', each ' if described.domain else ''}{described.domain}"
    many = get_origin(item.type) is list and described.domain
    return f"a list of at least one, each {described.domain}" if many else described.domain


def type_in_words(kind: Any) -> str:
    """Returns the type of a field in words that follow "must be".

    >>> type_in_words(list[int] | None)
    'a list of whole numbers, or null'
    """
    if isinstance(kind, UnionType):
        return f"{type_in_words(get_args(kind)[0])}, or null"
    if get_origin(kind) is dict:
        return f"names, each with {type_in_words(get_args(kind)[1])}"
    return f"a list of {LIST_WORDS[get_args(kind)[0]]}" if get_origin(kind) is list else TYPE_WORDS[kind]
