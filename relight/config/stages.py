"""Selects the settings that each stage reads."""

from collections.abc import Mapping
from typing import Any

# The groups or single settings that each stage gets. Changes of other settings cannot affect it.
READS = {
    "figure": ("figures",),
    "scan": ("figures",),
    "capture": ("figures", "bake.size"),
    "clean": ("clean",),
    "align": ("align",),
    "bake": ("bake",),
    "pack": ("split",),
    "split": ("split",),
    "lights": ("panoramas", "lights", "bake.order"),
    "train": ("model", "loss", "train", "augment", "track", "code"),
    "evaluate": ("evaluate", "track"),
    "baselines": ("evaluate", "train.color", "bake.order"),
    "tables": ("evaluate",),
    "plates": ("evaluate",),
    "sheets": ("evaluate",),
    "viewer": ("name", "evaluate"),
    "light_transfer": ("evaluate",),
    "trace": ("evaluate", "trace", "panoramas", "bake.order", "bake.rays"),
    "path_traced": ("evaluate",),
    "inference_time": ("model", "timing"),
    "benchmark_scores": ("benchmark",),
    "report": ("evaluate", "name"),
}

# Settings of READS on which a stage's outputs do not depend. They are omitted from its file: a change re-runs nothing.
WITHOUT_EFFECT = {
    "figure": ("figures.first", "figures.count", "figures.only"),
    "scan": ("figures.first", "figures.count", "figures.only"),
    "capture": ("figures.first", "figures.count", "figures.only"),
    "train": ("track",),
    "evaluate": ("track", "evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "baselines": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "tables": ("evaluate.plates", "evaluate.sheet"),
    "plates": ("evaluate.bootstrap", "evaluate.sheet", "evaluate.seed"),
    "sheets": ("evaluate.bootstrap", "evaluate.plates", "evaluate.seed"),
    "viewer": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "trace": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "light_transfer": ("evaluate.bootstrap", "evaluate.sheet", "evaluate.seed"),
    "path_traced": ("evaluate.bootstrap", "evaluate.sheet", "evaluate.seed"),
}


def view(tree: Mapping[str, Any], stage: str) -> dict[str, Any]:
    """Returns the settings on which a stage's outputs depend: those of READS without WITHOUT_EFFECT.

    Args:
        tree: all settings, as plain values by group.
        stage: a name in READS.
    """
    part: dict[str, Any] = {}
    for key in READS[stage]:
        if key == "code":
            continue
        group, _, name = key.partition(".")
        value = tree[group]
        part[group] = {**part.get(group, {}), name: value[name]} if name else value
    for key in WITHOUT_EFFECT.get(stage, ()):
        group, _, name = key.partition(".")
        if name:
            part[group] = {other: value for other, value in part[group].items() if other != name}
        else:
            del part[group]
    return part
