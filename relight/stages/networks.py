"""Finds the networks of an experiment."""

import json
from pathlib import Path


def networks_of(experiments: Path, name: str, folder: Path) -> tuple[dict[str, Path], dict[str, Path]]:
    """Finds the networks of an experiment.

    Args:
        experiments: those of the run (.json).
        name: name of the experiment.
        folder: folder of the networks.

    Returns:
        The files of all trainings by name (ours_full.s0), and those of the first training of each row by row
        (ours_full).
    """
    trainings_of = json.loads(experiments.read_text())[name]["trainings"]
    files = {
        training: folder / f"{training}.safetensors" for trainings in trainings_of.values() for training in trainings
    }
    return files, {row: files[trainings[0]] for row, trainings in trainings_of.items()}
