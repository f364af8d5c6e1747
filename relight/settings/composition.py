"""Composes the settings from the files in conf/ and overrides."""

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from relight.core.errors import UserError
from relight.settings.checks import check, no_choice, no_such
from relight.settings.schema import FIELDS, Config
from relight.settings.setting import setting_of

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

_PACKAGE = Path(__file__).resolve().parents[1]
ROOT = _PACKAGE.parent
IS_CLONE = (ROOT / "workflow" / "Snakefile").exists()  # else a wheel was installed, with conf/ in the package
CONF = (ROOT if IS_CLONE else _PACKAGE) / "conf"


def composed(overrides: Iterable[str] = ()) -> DictConfig:
    """Composes the whole tree of settings.

    Args:
        overrides: in Hydra's grammar, such as "train.lr=1e-3" or "scale=smoke".

    Returns:
        The tree, resolved and checked, with the fields of `Config`.

    Raises:
        UserError: names the wrong setting, and the values allowed.
    """
    # Imported here, since it takes half a second that inference does not need.
    from hydra import compose, initialize_config_dir
    from hydra.core.config_store import ConfigStore
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    from relight.settings.errors import explain

    if not CONF.is_dir():
        raise UserError(f"there is no folder {CONF}: the workflow runs from a clone of the repository")
    for path in CONF.rglob("*.yaml"):
        _require_plain_text(path)
    overrides = [quoted(override) for override in overrides]
    ConfigStore.instance().store(name="schema", node=Config)
    try:
        parsed = OverridesParser.create().parse_overrides(overrides)
        for override in parsed:
            _check_override(override)
        with initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = compose("config", overrides=overrides)
        for override in parsed:
            if override.key_or_group == "experiment" and isinstance(chosen := override.value(), list):
                _require_one_meaning(chosen)
        check(resolved(cfg), [override.key_or_group for override in parsed])
    except (HydraException, OmegaConfBaseException, yaml.YAMLError) as error:
        raise UserError(explain(error, presets())) from None
    return cfg


def _require_plain_text(path: Path) -> None:
    """Raises UserError for a preset in another encoding than Hydra reads, as some editors write it."""
    with suppress(UnicodeDecodeError):
        if not path.read_bytes().decode().startswith("\ufeff"):
            return
    raise UserError(f"{path}: save it in UTF-8 without a byte order mark, in which settings are read")


def _require_one_meaning(experiments: Iterable[str]) -> None:
    """Raises UserError if rows of one name differ between presets of experiments: the last one would count for all."""
    rows: dict[str, tuple[str, Any]] = {}
    for name in filter(presets()["experiment"].__contains__, experiments):  # others are of another folder
        preset = OmegaConf.load(CONF / "experiment" / f"{name}.yaml")
        for row, words in (OmegaConf.select(preset, "sweep.rows") or {}).items():
            other, first = rows.setdefault(row, (name, words))
            if first != words:
                raise UserError(f"experiment=[{other},{name}]: their rows {row} differ: rename one of them")


def quoted(override: str) -> str:
    """Quotes the value of a setting that takes any text, such as a folder, so that all its signs stand for themselves.

    >>> quoted("figures.folder=/data/a=b, #2")
    'figures.folder="/data/a=b, #2"'
    >>> quoted("train.lr=1e-3"), quoted("figures.folder=null")
    ('train.lr=1e-3', 'figures.folder=null')
    """
    key, separator, value = override.partition("=")
    field = FIELDS.get(key.lstrip("+"))
    is_text = field is not None and field.type in (str, str | None) and not setting_of(field).choices
    if not separator or not is_text or value in ("", "null") or value[0] in "'\"" or value.startswith("${"):
        return override
    # Hydra reads \" as a quote, and \\ as a backslash only in front of a quote or at the end.
    escaped = re.sub(r"(\\*)(\"|$)", lambda match: match[1] * 2 + match[2].replace('"', '\\"'), value)
    return f'{key}="{escaped}"'


def presets() -> dict[str, list[str]]:
    """Returns the names of the presets of each group in conf/."""
    folders = [folder for folder in sorted(CONF.iterdir()) if folder.is_dir()]
    return {folder.name: sorted(path.stem for path in folder.glob("*.yaml")) for folder in folders}


def read_preset(group: str, name: str = "default") -> Any:
    """Reads one preset that does not depend on others, without Hydra.

    Args:
        group: folder in conf/, such as `lights`.
        name: name of the preset.

    Returns:
        The group's dataclass, such as `Lights`.

    Raises:
        UserError: if there is no such group or preset.
    """
    known = {key: names for key, names in presets().items() if key in Config.__dataclass_fields__}
    if name not in known.get(group, ()):
        raise UserError(no_choice(group, name, known[group]) if group in known else no_such(group, known))
    schema, preset = OmegaConf.structured(getattr(Config(), group)), OmegaConf.load(CONF / group / f"{name}.yaml")
    return OmegaConf.to_object(OmegaConf.merge(schema, preset))


def resolved(cfg: DictConfig) -> DictConfig:
    """Replaces references such as ${bake.order} by their values, in place, and returns the tree.

    Resolvers are refused, since settings can come from untrusted files, the environment contains secrets, and resolved
    values are written to results and to MLflow.

    Raises:
        UserError: for ${oc.env:...} and other calls of resolvers.
    """
    for key, value in flat(OmegaConf.to_container(cfg)).items():
        if call := re.search(r"\$\{\s*[\w.]+\s*:.*?\}", str(value)):
            raise UserError(f"{key}: {call[0]} is not resolved in settings; write the value itself")
    OmegaConf.resolve(cfg)
    return cfg


def flat(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Flattens nested dictionaries: {"a": {"b": 1}} becomes {"a.b": 1}.

    Args:
        tree: of dictionaries; all other values are leaves.
        prefix: text before all keys.
    """
    out: dict[str, Any] = {}
    for key, value in tree.items():
        out.update(flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value})
    return out


def _check_override(override: "Override") -> None:
    """Raises UserError for overrides that Hydra accepts, but that do not give one value to a setting."""
    text, key = override.input_line, override.key_or_group
    if override.is_sweep_override():
        raise UserError(f"{text} has several values: `relight run -m` sweeps over them; a list is written as [a,b]")
    if override.is_delete():
        if key.partition(".")[0] in Config.__dataclass_fields__:
            raise UserError(f"{text}: a setting cannot be removed; give it another value")
    elif key in (known := presets()) and not isinstance(override.value(), str | list):
        raise UserError(no_choice(key, str(text).partition("=")[2], known[key]))
