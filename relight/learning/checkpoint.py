"""Networks on disk: safetensors that hold the weights and, in their header, all that is needed to build the network."""

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

LARGEST = 8192  # px of the pictures of a network that is read


def save_network(path: Path, network: Network, model: Model, half: bool = False, **config: dict) -> None:
    """Writes the weights (float32, or float16 if `half`) with the network's size, its `model` settings and `config`.

    `config` is any plain values worth keeping beside them (settings of loss and training, a model card's facts).
    """
    weights = {name: tensor.detach().cpu().contiguous() for name, tensor in network.state_dict().items()}
    if half:
        weights = {name: tensor.half() if tensor.is_floating_point() else tensor for name, tensor in weights.items()}
    config = {"size": network.size, "model": asdict(model), **config}
    with whole(path) as tmp:
        save_file(weights, tmp, metadata={"relight": json.dumps(config)})


def read_config(path: Path | str) -> dict:
    """What was saved beside the weights, alone. Raises UserError as `load_network` does."""
    path = existing(path, "network")
    try:
        with safe_open(path, "np") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise UserError(f"{path} is not a safetensors file ({error}): give one that relight's training wrote") from None
    try:
        return json.loads(metadata["relight"])
    except (KeyError, ValueError, RecursionError):
        raise UserError(f"{path} holds no relight network: give a file that relight's training wrote") from None


def load_network(path: Path | str, device: str | torch.device = "cpu") -> tuple[Network, dict]:
    """The network, float32 and in evaluation mode, and its config: size, model, and whatever was saved beside them.

    Raises UserError for a file that is not there, not safetensors, or not a network of this project.
    """
    config = read_config(path)
    try:
        model, size = Model(**config["model"]), config["size"]
        if unset := [name for name, value in vars(model).items() if value == MISSING]:
            raise KeyError(f"it does not say model.{unset[0]}")
        if not size <= LARGEST:
            raise ValueError(f"it is of {size} px; {LARGEST} are the most")
        with torch.device("meta"):  # shapes without memory: what a header asks for is compared with the file first
            network = build(model, size)
        with safe_open(path, "pt") as file:
            weights = {name: file.get_tensor(name) for name in file.keys()}
        kinds = {name: tensor.dtype for name, tensor in network.state_dict().items()}
        weights = {name: tensor.to(kinds.get(name, tensor.dtype)) for name, tensor in weights.items()}
        network.load_state_dict(weights, assign=True)
    except (TypeError, KeyError, ValueError, RuntimeError, OverflowError, AttributeError, SafetensorError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise UserError(f"{path} does not fit this version of relight: {reason}") from None
    return network.to(device, memory_format=network.layout).eval(), config
