"""The state that a killed training goes on from."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import torch

from relight.config import Augment, Loss, Model, Train
from relight.files import existing, whole


def fingerprint(model: Model, loss: Loss, train: Train, augment: Augment, *files: Path) -> str:
    """Changes with any setting, `train.version` (raised with the code) among them, and with the content of any input,
    `train.start` included. Raises UserError for an input that is not there."""
    settings = [asdict(part) for part in (model, loss, train, augment)]
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    for path in [*files, *([train.start] if train.start else [])]:
        with open(existing(path, "training"), "rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def save_state(path: Path, digest: str, parts: dict, step: int, history: list[dict]) -> None:
    """What a killed training needs, whole or not at all."""
    with whole(path) as tmp:
        states = {name: part.state_dict() for name, part in parts.items()}
        with open(tmp, "wb") as file:  # torch's own file would hide why a write failed
            torch.save({"settings": digest, "step": step, "history": history, **states}, file)


def restore(path: Path, digest: str, parts: dict, device: torch.device) -> tuple[int, list[dict], str]:
    """Loads a state of the same settings into `parts`, if there is one.

    Returns the step to go on with, what was logged before, and a line about what was found for whoever watches.
    """
    if not path.exists():
        return 0, [], ""
    try:
        found = torch.load(path, map_location=device, weights_only=True)
        same = found["settings"] == digest
    except Exception as error:  # of pickle, zipfile and torch: it was damaged on its disk, for it is written whole
        return 0, [], f"{path} cannot be read ({type(error).__name__}): starting from the beginning"
    if not same:
        return 0, [], f"{path} belongs to other settings or data: starting from the beginning"
    for name, part in parts.items():
        part.load_state_dict(found[name])
    return found["step"], found["history"], f"going on from step {found['step']} ({path})"
