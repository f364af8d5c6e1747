"""The part of the settings that each stage reads."""

from typing import Any

from omegaconf import DictConfig, OmegaConf

# What each stage may read, groups or single settings: the rest of the tree is not handed to it, so a change there
# cannot matter to it.
READS = {
    "figure": ("figures",),
    "scan": ("figures",),
    "clean": ("clean",),
    "align": ("align",),
    "bake": ("bake",),
    "pack": ("split",),
    "split": ("split",),
    "lights": ("panoramas", "lights", "bake.order"),
    "train": ("model", "loss", "train", "augment", "track"),
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
    "report": ("evaluate", "name"),
}

# What a stage reads and its outputs do not depend on: the workflow tells it in other ways or not at all, so that a
# change re-runs nothing.
PASSED_OVER = {
    "figure": ("figures.first", "figures.count"),
    "scan": ("figures.first", "figures.count"),
    "train": ("track",),
    "evaluate": ("track", "evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "baselines": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "tables": ("evaluate.plates", "evaluate.sheet"),
    "plates": ("evaluate.bootstrap", "evaluate.sheet", "evaluate.seed"),
    "sheets": ("evaluate.bootstrap", "evaluate.plates", "evaluate.seed"),
    "viewer": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "trace": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "light_transfer": ("evaluate.sheet",),
    "path_traced": ("evaluate.sheet",),
}


def view(cfg: DictConfig, stage: str) -> dict[str, Any]:
    """Returns the part of the tree that a stage's outputs depend on, as plain values."""
    part = OmegaConf.create()
    for key in READS[stage]:
        OmegaConf.update(part, key, OmegaConf.select(cfg, key))
    plain: Any = OmegaConf.to_container(part, resolve=True)
    for key in PASSED_OVER.get(stage, ()):
        group, _, name = key.partition(".")
        plain[group].pop(name) if name else plain.pop(group)
    return dict(plain)
