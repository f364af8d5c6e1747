"""Converts errors of Hydra, OmegaConf and YAML to one sentence."""

from collections.abc import Iterable, Mapping

import yaml
from hydra.errors import MissingConfigException, OverrideParseException
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException, ValidationError

from relight.core.errors import causes
from relight.settings.checks import no_choice, no_such
from relight.settings.schema import field_of
from relight.settings.setting import type_in_words


def explain(error: Exception, groups: Mapping[str, Iterable[str]]) -> str:
    """Returns one line that names the setting and the values allowed, from the exception or its causes.

    Args:
        error: error that Hydra, OmegaConf or the YAML reader raised.
        groups: names of the presets of all groups of settings.
    """
    for cause in causes(error):
        match cause:
            case yaml.MarkedYAMLError(problem_mark=yaml.Mark() as mark):
                return f"{mark.name}, line {mark.line + 1}: {cause.problem}"
            case MissingConfigException(missing_cfg_file=str(preset)) if preset.partition("/")[0] in groups:
                group, _, name = preset.partition("/")
                return no_choice(group, name, groups[group])
            case OverrideParseException(override=override):
                return (
                    f"cannot read the override {override!r}: write key=value, lists as key=[a,b], and a value with "
                    """signs such as = # ( or ' in two pairs of quotes, 'key="value"'"""
                )
            case ConfigKeyError() | ConfigAttributeError() if cause.full_key and cause.parent_node is not None:
                known = [str(key) for key in cause.parent_node]
                if "." not in cause.full_key:
                    known = list(dict.fromkeys([*groups, *known]))
                return no_such(cause.full_key, known)
            case ValidationError(full_key=str(key)) if field := field_of(key.partition("[")[0]):
                value = "null" if cause.value is None else repr(cause.value)
                return f"{key.partition('[')[0]} must be {type_in_words(field.type)}, not {value}"
            case OmegaConfBaseException(full_key=str(key), msg=str(text)) if key:
                return f"{key}: {_first_line(text)}"
    return _first_line(str(error))


def _first_line(text: str) -> str:
    """Returns the first line of a message, with single blanks."""
    return " ".join(text.partition("\n")[0].split())
