"""One setting: what it means, which values it may have, and its field in the schema."""

from dataclasses import Field, dataclass, field
from types import UnionType
from typing import Any, get_args, get_origin

from omegaconf import MISSING

ONE = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
MANY = {int: "whole numbers", float: "numbers", str: "texts"}


@dataclass(frozen=True)
class Setting:
    """What a setting means, and which values it may have. Of a list, every item must have such a value.

    Attributes:
        about: what it is, with its unit.
        choices: the texts that it may be; empty where any text will do.
        least, above, most, below: bounds of a number, the first and third included, the others not.
        multiple: of what a number must be a multiple.
        interval: whether it is a list [least, most] of two numbers.
    """

    about: str
    choices: tuple[str, ...] = ()
    least: float | None = None
    above: float | None = None
    most: float | None = None
    below: float | None = None
    multiple: int | None = None
    interval: bool = False

    @property
    def domain(self) -> str:
        """Which values it, or an item of it, may have, in words that follow "must be"; empty where all will do."""
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
        """Whether it may have this value, which has the type of its field; None is for OmegaConf to judge."""
        if value is None or not (self.domain or self.interval):
            return True
        if isinstance(value, str | int | float):
            return self._holds(value)
        ordered = len(value) == 2 and value[0] <= value[1] if self.interval else len(value) > 0
        return ordered and all(map(self._holds, value))

    def _holds(self, value: Any) -> bool:
        return (
            (not self.choices or value in self.choices)
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
            and (self.multiple is None or value % self.multiple == 0)
        )


def setting(about: str, default: Any = MISSING, **rules: Any) -> Any:
    """A field of the schema.

    Args:
        about: what it is, with its unit.
        default: only for settings that files may leave out: those that came after files were written, and those that
            the workflow hands to no stage whose outputs do not depend on them (`WITHOUT_EFFECT`).
        **rules: which values it may have, as in `Setting`.
    """
    metadata = {"setting": Setting(about, **rules)}
    if isinstance(default, list | dict):
        return field(default_factory=default.copy, metadata=metadata)
    return field(default=default, metadata=metadata)


def setting_of(item: Field[Any]) -> Setting:
    """Returns what `setting` put into a field."""
    found: Setting = item.metadata["setting"]
    return found


def domain_in_words(item: Field[Any]) -> str:
    """Returns which values of its type a field may have, in words that follow "must be"; empty where all will do."""
    found = setting_of(item)
    if found.interval:
        return f"[least, most]{', each ' if found.domain else ''}{found.domain}"
    many = get_origin(item.type) is list and found.domain
    return f"a list, each {found.domain}" if many else found.domain


def type_in_words(kind: Any) -> str:
    """Returns the type of a field in words that follow "must be".

    >>> type_in_words(list[int] | None)
    'a list of whole numbers, or null'
    """
    if isinstance(kind, UnionType):
        return f"{type_in_words(get_args(kind)[0])}, or null"
    if get_origin(kind) is dict:
        return f"names, each with {type_in_words(get_args(kind)[1])}"
    if get_origin(kind) is list:
        return f"a list of {MANY[get_args(kind)[0]]}"
    return ONE[kind]
