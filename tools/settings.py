"""Makes the site's page of all settings, from the schema and the presets in conf/ (tools/hooks.py)."""

from dataclasses import Field, fields, is_dataclass
from typing import Any, get_origin

import yaml
from omegaconf import MISSING, DictConfig, OmegaConf

from relight.settings import CONF, Config, Experiment, composed, flat, presets
from relight.settings.schema import EXPERIMENT, FIELDS
from relight.settings.setting import domain_in_words, setting_of, type_in_words

HEAD = """\
# Settings

All settings of `relight run`, from `relight/settings/schema.py` and `conf/`.
[The workflow](workflow.md) says how to give them. The defaults are those of a run without overrides, `scale=demo`.
"""


def page() -> str:
    """Returns the text of the page."""
    defaults = yaml.safe_load((CONF / "config.yaml").read_text(encoding="utf-8"))["defaults"]
    chosen = {group: name for item in defaults if isinstance(item, dict) for group, name in item.items()}
    parts = [HEAD, *scales(chosen["scale"]), *protocols(), *experiments(chosen["experiment"])]
    cfg = composed()
    parts += ["## name", f"`name`: {setting_of(FIELDS['name']).about}; it comes with the scale (`{cfg.name}`)."]
    for group in fields(Config):
        if is_dataclass(group.type):
            parts += [f"## {group.name}", paragraph(group.type)]
            if len(presets().get(group.name, ())) > 1:
                parts.append(listed_presets(group.name, [chosen[group.name]]))
            of_group = {key: item for key, item in FIELDS.items() if key.startswith(f"{group.name}.")}
            parts.append(table(of_group, cfg))
            nested = [item for item in fields(group.type) if is_dataclass(item.type)]
            parts += [f"`{group.name}.{item.name}`: {paragraph(item.type)}" for item in nested]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def scales(default: str) -> list[str]:
    """Returns the section of the presets of `scale`, with the settings of each."""
    files = {name: OmegaConf.load(CONF / "scale" / f"{name}.yaml") for name in presets()["scale"]}
    by_scale = {name: flat(OmegaConf.to_container(file)) for name, file in files.items()}
    keys = dict.fromkeys(key for settings in by_scale.values() for key in settings)
    rows = []
    for key in keys:
        cells = [shown(settings[key]) if key in settings else "" for settings in by_scale.values()]
        rows.append([f"`{key}`", *cells])
    names = [f"`{name}`" for name in by_scale]
    return ["## scale", listed_presets("scale", [default], overrides=False), markdown(["", *names], rows)]


def protocols() -> list[str]:
    """Returns the section of the presets of `protocol`, of which there is none by default."""
    return ["## protocol", listed_presets("protocol", [], overrides=False)]


def experiments(default: list[str]) -> list[str]:
    """Returns the section of the presets of `experiment`, and the settings of an experiment."""
    about = paragraph(Experiment)
    listed = listed_presets("experiment", default, overrides=False)
    return ["## experiment", about, listed, table(EXPERIMENT, cfg=None)]


def listed_presets(group: str, default: list[str], overrides: bool = True) -> str:
    """Returns a list of the presets of a group in Markdown, with the comment at the top of each file.

    Args:
        group: folder in conf/.
        default: the presets that are chosen by default.
        overrides: whether the differences of a preset from that on which it is based are listed, too.
    """
    lines = []
    for name in presets()[group]:
        text = (CONF / group / f"{name}.yaml").read_text(encoding="utf-8")
        comment = [line[2:] for line in text.splitlines() if line.startswith("# ") and "@package" not in line]
        content = yaml.safe_load(text) or {}
        bases = [base for base in content.pop("defaults", []) if base != "_self_"]
        difference = ""
        if overrides and bases and content:
            given = ", ".join(f"`{key}={shown(value)}`" for key, value in content.items())
            difference = f" (`{bases[0]}` with {given})"
        lines.append(f"- `{group}={name}`{' (default)' if name in default else ''}: {' '.join(comment)}{difference}")
    return "\n".join(lines)


def table(items: dict[str, Field[Any]], cfg: DictConfig | None) -> str:
    """Returns a table of settings in Markdown.

    Args:
        items: key -> field of the schema.
        cfg: the tree with the default values; None for the defaults of the schema.
    """
    rows = []
    for key, item in items.items():
        value = default_of(item) if cfg is None else OmegaConf.select(cfg, key)
        if key == "sweep.rows":
            value = ", ".join(value)
        about = setting_of(item).about
        rows.append([f"`{key}`", shown(value), values(item), about[0].upper() + about[1:]])
    return markdown(["setting", "default", "values", "meaning"], rows)


def default_of(item: Field[Any]) -> Any:
    """Returns the default of a field of the schema."""
    return item.default_factory() if callable(item.default_factory) else item.default


def values(item: Field[Any]) -> str:
    """Returns the values that a field allows, in words: its choices, or its type and its domain."""
    if choices := setting_of(item).choices:
        return ("a list of " if get_origin(item.type) is list else "") + ", ".join(f"`{name}`" for name in choices)
    kind, null, _ = type_in_words(item.type).partition(", or null")
    domain = domain_in_words(item)
    if not domain:
        return kind + null
    return (domain if get_origin(item.type) is list else f"{kind}, {domain}") + null


def paragraph(schema: type) -> str:
    """Returns the docstring of a group in one line."""
    return " ".join((schema.__doc__ or "").split())


def shown(value: object) -> str:
    """Returns a value in YAML."""
    if value is MISSING:
        return ""
    plain = OmegaConf.to_container(value) if OmegaConf.is_config(value) else value
    return yaml.safe_dump(plain, default_flow_style=True).split("\n")[0]


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """Returns a table in Markdown."""
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
