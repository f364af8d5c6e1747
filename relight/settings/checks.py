"""Checks settings that have the right type: unknown keys, domains, and consistency."""

import difflib
import math
import re
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

from omegaconf import DictConfig, OmegaConf

from relight import extensions
from relight.core.errors import UserError
from relight.settings.schema import EXPERIMENT, FIELDS, STRENGTHS, field_of
from relight.settings.scores import BASELINES, COLUMNS, label
from relight.settings.setting import domain_in_words, setting_of

NAME_PATTERN, MAX_NAME_LENGTH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._+-]*"), 100


def check(cfg: DictConfig, given: Iterable[str] = ()) -> None:
    """Checks a tree for unknown settings, values out of range, inconsistent values, and given ones without effect.

    Args:
        cfg: the tree.
        given: keys of the settings that the user gave.

    Raises:
        UserError: about the first wrong setting.
    """
    for key in ("name", "data"):
        if (results := OmegaConf.select(cfg, key)) is not None:
            check_name(key, results)
    for key in ("sweep.rows", "experiments"):
        for name in OmegaConf.select(cfg, key) or ():
            check_name(key, name)
    for sentence in chain(_unknown(cfg), _out_of_range(cfg), _inconsistent(cfg), _without_effect(cfg, given)):
        raise UserError(sentence)


def check_name(what: str, name: str) -> None:
    """Checks that a name is safe in paths and commands.

    Args:
        what: the setting, for the error: `name`, `data`, `rows`.
        name: name of results, a row or an experiment.

    Raises:
        UserError: if it is not safe.
    """
    if not NAME_PATTERN.fullmatch(str(name)) or len(str(name)) > MAX_NAME_LENGTH:
        raise UserError(
            f"{what}: {str(name)!r} is not a valid name: use up to {MAX_NAME_LENGTH} letters, digits, '_', '.', '+' "
            "and '-', and none of the last three first"
        )


def no_such(key: str, known: Iterable[str]) -> str:
    """Returns the message that there is no setting of a name, with the most similar one and the known ones.

    Args:
        key: the unknown setting, such as train.lrr.
        known: names beside which it would stand, such as those of the group `train`.
    """
    known = list(known)
    if not known or field_of(key.rpartition(".")[0]):  # names of the user
        here = f"there are {', '.join(known)}" if known else "nothing has this name yet"
        return f"{key}: {here}; to add it, write +{key}=<value>"
    name = key.rpartition(".")[2]
    elsewhere: dict[str, list[str]] = {}
    for full_name in FIELDS:
        elsewhere.setdefault(full_name.rpartition(".")[2], []).append(full_name)
    close = [] if name in elsewhere else difflib.get_close_matches(name, known, n=1)
    close = close or elsewhere.get("".join(difflib.get_close_matches(name, elsewhere, n=1)), [])
    hint = f"did you mean {' or '.join(close)}? " if close else ""
    return f"{key}: no such setting; {hint}there are {', '.join(known)}"


def no_choice(group: str, name: str, choices: Iterable[str]) -> str:
    """Returns the message that a group of settings has no preset `name`, with the most similar one and all of them."""
    choices = list(choices)
    close = difflib.get_close_matches(name, choices, n=1)
    hint = f"did you mean {close[0]}? " if close else ""
    return f"{group}={name}: no such choice; {hint}{group} is one of {', '.join(choices)}"


def _unknown(cfg: DictConfig, above: str = "") -> Iterator[str]:
    """Yields messages about settings below the key `above` ("train.") that the schema lacks, as + adds them."""
    known = getattr(OmegaConf.get_type(cfg), "__dataclass_fields__", None)
    for key in map(str, cfg):
        if known is not None and key not in known:
            yield no_such(f"{above}{key}", known)
        elif not OmegaConf.is_missing(cfg, key) and isinstance(cfg[key], DictConfig):
            yield from _unknown(cfg[key], f"{above}{key}.")


def _out_of_range(cfg: DictConfig) -> Iterator[str]:
    """Yields messages about values outside the domains of settings."""
    fields = dict(FIELDS)
    for name in OmegaConf.select(cfg, "experiments") or ():
        fields |= {f"experiments.{name}.{key}": field for key, field in EXPERIMENT.items()}
    for key, field in fields.items():
        value = OmegaConf.select(cfg, key)
        if not setting_of(field).allows(value):
            yield f"{key} must be {domain_in_words(field)}, not {value}"


def _inconsistent(cfg: DictConfig) -> Iterator[str]:
    """Yields messages about inconsistent settings."""

    def get(key: str) -> Any:
        return OmegaConf.select(cfg, key)

    if get("lights.test") is not None and get("lights.test") >= get("lights.clusters"):
        yield f"lights.test {get('lights.test')} must be below lights.clusters {get('lights.clusters')}"
    up, front = get("align.up") or "auto", get("align.front") or "auto"
    if "auto" not in (up, front) and up[1:] == front[1:]:
        yield f"align.up={up} and align.front={front} are the same axis: they must be at right angles"
    if (get("bake.supersample") or 1) ** 2 > (get("bake.rays") or math.inf):
        yield f"bake.supersample={get('bake.supersample')} needs bake.rays={get('bake.supersample') ** 2} at least"
    counts = [key for key, field in FIELDS.items() if setting_of(field).kind]
    if get("panoramas.source") == "generated" and not any(map(get, counts)):
        yield f"{', '.join(counts)} are 0: at least one panorama is needed"
    if get("train.only") and not get("train.start"):
        yield f"train.only={get('train.only')} needs train.start=<the network whose other parts are kept>"
    weights = [get(key) for key, field in FIELDS.items() if setting_of(field).teaches]
    if None not in weights and not any([*weights, *(get("loss.extra") or {}).values()]):
        yield "every weight in the group loss is 0: give one, such as loss=full"
    augments = any([*(get(f"augment.{name}") for name in STRENGTHS), *(get("augment.exposure") or ())])
    if get("train.color") == "paper" and (get("train.size") or augments):
        yield "augment and train.size need train.color=photo, since they change pictures as cameras do"
    if get("model.name") == "unet" and get("model.light_head") == "strided":
        yield "model.name=unet has a pooled light head only: give model=unet or model.light_head=pooled"
    if get("model.name") == "unet" and get("model.dropout"):
        yield "model.name=unet has no dropout: give model=unet or model.dropout=0"
    if get("train.part") == "test" or "test" in (get("train.lights") or ()):
        supervised = [key for key, field in FIELDS.items() if setting_of(field).supervised]
        if used := [key for key in supervised if get(key)]:
            sentence = f"the test's pictures need losses without ground truth, and {used[0]} uses it"
            yield f"{sentence}: give loss=self_supervised"
    for row in {*BASELINES} & {*(get("sweep.rows") or ())}:
        yield f"sweep.rows.{row} has the name of a baseline: give it another"
    for name, experiment in (get("experiments") or {}).items():
        if unknown := [row for row in experiment.rows if row not in (get("sweep.rows") or {})]:
            yield f"experiments.{name}.rows: no row {unknown[0]} in sweep.rows; add it there"
        for pair in experiment.compare:
            first, _, second = pair.partition(" against ")
            rows = [*(get("sweep.rows") or {})]
            if first not in rows or second not in [*rows, *BASELINES]:
                known = f"a ROW of sweep.rows, and the second may be of {', '.join(BASELINES)}"
                yield f"experiments.{name}.compare: {pair!r} must be ROW against ROW, each {known}"
        if unknown := [row for row in experiment.labels if row not in experiment.rows]:
            yield f"experiments.{name}.labels: no row {unknown[0]} in experiments.{name}.rows"
        if unknown := [column for column in experiment.compare_in if column not in COLUMNS]:
            yield f"experiments.{name}.compare_in: {unknown[0]} must be a quantity and a reading, such as relit_rmse"
    by_label: dict[str, str] = {}
    for row in get("sweep.rows") or ():
        words = label(row, (get("experiments") or {}).values())
        if by_label.setdefault(words, row) != row:
            yield f"rows {by_label[words]} and {row} have the same label, {words}: give one of them another"
    if (get("figures.outfits") or 1) > 1 and (get("figures.source") != "generated" or get("bake.bounces")):
        yield "figures.outfits must be 1 with bake.bounces, which depend on albedo, and unless figures are generated"
    for name in get("loss.extra") or {}:
        if name not in extensions.names():
            yield f"loss.extra.{extensions.missing(name)}"
    for group, source in (("figures", "scans"), ("panoramas", "folder")):
        chosen, folder = get(f"{group}.source"), get(f"{group}.folder")
        if chosen == source and not folder:
            yield f"{group}.source={source} needs {group}.folder=<the folder to read>"
        if chosen == "generated" and folder:
            yield f"{group}.folder={folder} is not read by {group}.source=generated: give {group}={source}"


def _without_effect(cfg: DictConfig, given: Iterable[str]) -> Iterator[str]:
    """Yields messages about given settings that the source of their group does not read.

    Scales and experiments may set them all the same. Extensions may read all, and `figures.outfits`, with which a user
    undoes an experiment, is checked by value.
    """
    for key in given:
        source = f"{key.partition('.')[0]}.source"
        if (field := FIELDS.get(key)) and (unread := setting_of(field).unread) == OmegaConf.select(cfg, source):
            yield f"{key} is not read by {source}={unread}: leave it out"
