"""Networks and interrupted trainings on disk.

A network is a safetensors file whose header holds all that is needed to build it. The state of a training is a file of
torch that is read with `weights_only=True`, so that neither can run code.
"""

import json
from dataclasses import asdict
from pathlib import Path

import torch
from omegaconf import MISSING
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from relight.config import Model
from relight.files import UserError, existing, whole
from relight.learning.networks import Network, build


def save_network(path: Path, network: Network, model: Model, half: bool = False, **config: dict) -> None:
    """Writes a network, whole or not at all.

    Args:
        path: .safetensors.
        network: its weights are written as float32.
        model: the settings that it was built with.
        half: write float16 instead.
        config: plain values to keep beside them, such as the settings of the training.
    """
    weights = {name: tensor.detach().cpu().contiguous() for name, tensor in network.state_dict().items()}
    if half:
        weights = {name: tensor.half() if tensor.is_floating_point() else tensor for name, tensor in weights.items()}
    config = {"size": network.size, "model": asdict(model), **config}
    with whole(path) as tmp:
        save_file(weights, tmp, metadata={"relight": json.dumps(config)})


def read_config(path: Path | str) -> dict:
    """Reads what was saved beside the weights, without the weights.

    Raises:
        UserError: if the file does not exist, is not safetensors, or holds no network of this project.
    """
    path = existing(path, "network")
    try:
        with safe_open(path, "np") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise UserError(f"{path} is not a safetensors file ({error}): give one that relight's training wrote") from None
    try:
        return json.loads(metadata["relight"])
    except (KeyError, ValueError):
        raise UserError(f"{path} holds no relight network: give a file that relight's training wrote") from None


def load_network(path: Path | str, device: str | torch.device = "cpu") -> tuple[Network, dict]:
    """Reads a network.

    Returns:
        The network, float32 and in evaluation mode; and its config: size, model, and what else was saved beside them.

    Raises:
        UserError: if the file does not exist, is not safetensors, or holds no network of this version.
    """
    config = read_config(path)
    try:
        with safe_open(path, "pt") as file:
            weights = {name: file.get_tensor(name) for name in file.keys()}
        model = Model(**config["model"])
        if unset := [name for name, value in vars(model).items() if value == MISSING]:
            raise KeyError(f"it does not say model.{unset[0]}")
        with torch.random.fork_rng(devices=[]):  # building draws weights; the caller's random state is not ours
            network = build(model, config["size"])
        network.load_state_dict(weights)
    except (TypeError, KeyError, RuntimeError) as error:
        raise UserError(f"{path} does not fit this version of relight: {str(error).splitlines()[0]}") from None
    return network.to(device).eval(), config


def save_state(path: Path, digest: str, parts: dict, step: int, history: list[dict]) -> None:
    """Writes what an interrupted training needs, whole or not at all.

    Args:
        path: .pt.
        digest: the training's fingerprint.
        parts: modules and optimiser by name.
        step: steps done.
        history: rows of the log.
    """
    with whole(path) as tmp:
        states = {name: part.state_dict() for name, part in parts.items()}
        torch.save({"settings": digest, "step": step, "history": history, **states}, tmp)


def restore(path: Path, digest: str, parts: dict, device: torch.device) -> tuple[int, list[dict], str]:
    """Loads the state of the same training into `parts`, if there is one.

    Returns:
        The step to go on with, the rows logged before, and a line that says what was found, "" if nothing was.
    """
    if not path.exists():
        return 0, [], ""
    found = torch.load(path, map_location=device, weights_only=True)
    if found["settings"] != digest:
        return 0, [], f"{path} belongs to other settings or data: starting from the beginning"
    for name, part in parts.items():
        part.load_state_dict(found[name])
    return found["step"], found["history"], f"going on from step {found['step']} ({path})"
