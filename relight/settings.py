"""What there is to set, for people: the settings with their descriptions for --help, and completion on a command line.

The descriptions are the comments beside the fields in relight/config.py.
"""

import ast
import io
import textwrap
import tokenize
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from relight import config
from relight.config import CHOICES, CONF, Config

WIDTH = 110


@cache
def descriptions() -> dict[tuple[str, str], str]:
    """The comment beside each field of the schema, by (class, field)."""
    source = Path(config.__file__).read_text(encoding="utf-8")
    notes: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            notes[token.start[0]] = token.string.lstrip("# ")
    found = {}
    for made in ast.parse(source).body:
        for item in made.body if isinstance(made, ast.ClassDef) else ():
            if isinstance(item, ast.AnnAssign):
                lines = range(item.lineno, item.end_lineno + 1)
                found[made.name, item.target.id] = " ".join(notes[line] for line in lines if line in notes)
    return found


def choices() -> dict[str, list[str]]:
    """The presets of each group, by group."""
    return {
        folder.name: sorted(path.stem for path in folder.glob("*.yaml"))
        for folder in sorted(CONF.iterdir())
        if folder.is_dir()
    }


def listing(cfg: DictConfig, keys: Iterable[str]) -> str:
    """Groups (`train`) and single settings (`bake.order`) of a tree as text: presets, values, and what they are."""
    lines = []
    for key in keys:
        group, _, only = key.partition(".")
        presets = choices().get(group, [])
        node = cfg[group]
        if not isinstance(node, DictConfig):
            lines += ["", *_line(_said(group, node), descriptions()["Config", group])]
            continue
        lines += ["", f"  {group}={'|'.join(presets)}" if presets else f"  {group}"]
        for name in [only] if only else node:
            if not isinstance(node[name], DictConfig):
                about = descriptions().get((OmegaConf.get_type(node).__name__, name), "")
                lines += _line(_said(f"{group}.{name}", node[name]), about)
    return "\n".join(lines[1:])


def _line(setting: str, about: str) -> list[str]:
    return textwrap.wrap(f"    {setting:34s}  {about}", WIDTH, subsequent_indent=40 * " ")


def _said(key: str, value: object) -> str:
    shown = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    return f"{key}={shown}"


def overview(cfg: DictConfig) -> str:
    """The settings of `relight run`: what is trained and compared, then each group of the tree."""
    groups = [name for name in Config.__dataclass_fields__ if name not in ("sweep", "experiments")]
    lines = []
    for group in ("scale", "experiment"):
        presets = f"  {group}={' | '.join(choices()[group])}"
        lines += textwrap.wrap(presets, WIDTH, subsequent_indent=(len(group) + 3) * " ")
    lines += _line("sweep.only=[ROW,...]", descriptions()["Sweep", "only"])
    lines += _line("sweep.seeds=[0,...]", descriptions()["Sweep", "seeds"])
    return "\n".join([*lines, "", listing(cfg, groups)])


def complete(args: list[str], incomplete: str) -> list[str]:
    """What may stand in the place of an unfinished override, as shells ask for it.

    args: the words before it. bash takes `scale=sm` for three words, and wants the last one alone.
    """
    key, equals, value = incomplete.partition("=")
    if args[-1:] == ["="] or (not incomplete and args[-1:] and values(args[-1])):
        asked = args[-2] if args[-1] == "=" else args[-1]
        return [word for word in values(asked) if word.startswith(incomplete)]
    if equals:
        return [f"{key}={word}" for word in values(key) if word.startswith(value)]
    keys = [
        f"{group}.{name}"
        for group, field in Config.__dataclass_fields__.items()
        for name in getattr(field.type, "__dataclass_fields__", ())
    ]
    return [f"{word}=" for word in sorted({*choices(), "name", *keys}) if word.startswith(incomplete)]


def values(key: str) -> list[str]:
    """What a group or setting may be, where these are words."""
    group, _, name = key.partition(".")
    found = getattr(Config.__dataclass_fields__.get(group), "type", None)
    field = getattr(found, "__dataclass_fields__", {}).get(name)
    if field is not None and field.type is bool:
        return ["true", "false"]
    return choices().get(key) or list(CHOICES.get(key, ()))
