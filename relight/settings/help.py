"""Formats settings for --help."""

import textwrap

from omegaconf import DictConfig

from relight.settings.composition import presets
from relight.settings.schema import FIELDS, Config
from relight.settings.setting import domain_in_words, setting_of

WIDTH = 110  # characters of a line
INDENT = 40  # characters before descriptions


def overview(cfg: DictConfig) -> str:
    """Returns the settings of `relight run` as text: presets of whole runs, then each group.

    Args:
        cfg: the tree with the values.
    """
    lines = []
    for group in ("scale", "protocol", "experiment"):
        text = f"  {group}={' | '.join(presets()[group])}"
        lines += textwrap.wrap(text, WIDTH, subsequent_indent=(len(group) + 3) * " ")
    lines += [_line("sweep.only", "[ROW,...]"), _line("sweep.seeds", "[0,...]")]
    for group in (name for name in Config.__dataclass_fields__ if name not in ("sweep", "experiments")):
        if not isinstance(cfg[group], DictConfig):
            lines += ["", _line(group, cfg[group])]
            continue
        known = presets().get(group)
        lines += ["", f"  {group}={'|'.join(known)}" if known else f"  {group}"]
        lines += [_line(f"{group}.{name}", cfg[group][name]) for name in cfg[group] if f"{group}.{name}" in FIELDS]
    return "\n".join(lines)


def _line(key: str, value: object) -> str:
    """Returns a line of the table, `key=value  description (domain)`, wrapped."""
    shown = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    about, domain = setting_of(FIELDS[key]).about, domain_in_words(FIELDS[key])
    assignment, left, gap = f"{key}={shown}", 4 * " ", 2 * " "
    text = f"{left}{assignment:{INDENT - len(left + gap)}s}{gap}{about}{f' ({domain})' if domain else ''}"
    return "\n".join(textwrap.wrap(text, WIDTH, subsequent_indent=INDENT * " "))
