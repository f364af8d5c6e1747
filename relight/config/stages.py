"""Selects the settings that each stage reads."""

from collections.abc import Mapping
from typing import Any

from relight.config.schema import FIELDS
from relight.config.setting import setting_of

# The groups or single settings that each stage gets. Changes of other settings cannot affect it.
READS: dict[str, tuple[str, ...]] = {
    "figure": ("figures",),
    "scan": ("figures",),
    "clean": ("clean",),
    "align": ("align",),
    "bake": ("bake",),
    "pack": ("split",),
    "split": ("split",),
    "lights": ("panoramas", "lights", "bake.order"),
    "train": ("model", "loss", "train", "augment", "track", "code"),
    "evaluate": ("track",),
    "baselines": ("train.color", "bake.order"),
    "tables": (),
    "plates": (),
    "sheets": (),
    "viewer": ("name",),
    "light_transfer": (),
    "trace": ("trace", "panoramas", "bake.order", "bake.rays"),
    "path_traced": (),
    "plate": (),
    "report": ("name",),
}


def view(tree: Mapping[str, Any], stage: str) -> dict[str, Any]:
    """Returns the settings on which a stage's outputs depend: those of READS whose change re-runs it.

    Args:
        tree: all settings, as plain values by group.
        stage: a name in READS.
    """
    without_effect = {key for key, item in FIELDS.items() if not setting_of(item).reruns}
    part: dict[str, Any] = {}
    for key in READS[stage]:
        if key == "code":  # which is known only when the settings are written
            continue
        group, _, name = key.partition(".")
        value = tree[group]
        if isinstance(value, Mapping):
            names = [name] if name else [name for name in value if f"{group}.{name}" not in without_effect]
            value = {**part.get(group, {}), **{name: value[name] for name in names}}
        if value != {}:
            part[group] = value
    return part
