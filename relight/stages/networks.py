"""Finds the networks of an experiment."""

import json
from pathlib import Path


def networks_of(experiments: Path, name: str, folder: Path) -> tuple[dict[str, Path], dict[str, Path]]:
    """Finds the networks of an experiment.

    Args:
        experiments: those of the run (.json).
        name: of the experiment.
        folder: of the networks.

    Returns:
        The files of all trainings by run (ours_full.s0), and those of the first training of each row by row
        (ours_full).
    """
    rows = json.loads(experiments.read_text())[name]["runs"]
    by_run = {run: folder / f"{run}.safetensors" for runs in rows.values() for run in runs}
    return by_run, {row: by_run[runs[0]] for row, runs in rows.items()}
