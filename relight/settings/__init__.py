"""Settings: their schema, composition from conf/, and checks."""

from relight.settings.checks import MAX_NAME_LENGTH, check, check_name
from relight.settings.composition import CONF, IS_CLONE, ROOT, composed, flat, presets, read_preset, resolved
from relight.settings.schema import (
    NO_AUGMENTATION,
    Align,
    Augment,
    Bake,
    Config,
    Experiment,
    Figures,
    Lights,
    Loss,
    Model,
    Panoramas,
    Split,
    Sweep,
    Track,
    Train,
)

__all__ = [
    "CONF", "IS_CLONE", "MAX_NAME_LENGTH", "NO_AUGMENTATION", "ROOT",
    "Align", "Augment", "Bake", "Config", "Experiment", "Figures", "Lights", "Loss", "Model",
    "Panoramas", "Split", "Sweep", "Track", "Train",
    "check", "check_name", "composed", "flat", "presets", "read_preset", "resolved",
]  # fmt: skip
