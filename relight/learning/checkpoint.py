"""Networks and interrupted trainings on disk.

A network is a safetensors file whose header holds the settings to build it, or the .onnx file of one
(relight.learning.export). The state of a training is a file of torch, read with `weights_only=True`. None of them can
run code when it is read.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from omegaconf import MISSING
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from relight.core.errors import UserError
from relight.core.files import atomic_write, existing_file
from relight.learning.networks import Network, build
from relight.photos.network import read_network
from relight.settings import Model

PREFIX = "network."  # of the weights' names in an .onnx file
HALF = ".half"  # after the name of a constant of an .onnx file that is stored in half precision
MAX_SIZE = 8192  # px, of the images of a network
Parts = Mapping[str, nn.Module | torch.optim.Optimizer]  # of a training whose state is kept, by name
History = list[dict[str, float]]  # rows of a training's log


def save_network(path: Path, network: Network, model: Model, **config: Any) -> None:
    """Writes a network, whole or not at all.

    Args:
        path: .safetensors.
        network: its weights are written as float32.
        model: the settings that it was built with.
        config: plain values to store in the header, such as the settings of the training.
    """
    weights = {name: tensor.detach().cpu().contiguous() for name, tensor in network.state_dict().items()}
    header = {"size": network.size, "model": asdict(model), **config}
    with atomic_write(path) as tmp:
        save_file(weights, tmp, metadata={"relight": json.dumps(header)})


def read_config(path: Path | str) -> dict[str, Any]:
    """Reads the header of a network: its size, its model and the other values that `save_network` was given.

    Raises:
        UserError: if the file does not exist, is neither safetensors nor .onnx, or holds no network of this project.
    """
    path = existing_file(path, "network")
    if path.suffix == ".onnx":
        return read_network(path).config
    try:
        with safe_open(path, "np") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise UserError(f"{path} is not a safetensors file ({error}): give one that relight's training wrote") from None
    try:
        return json.loads(metadata["relight"])
    except (KeyError, ValueError, RecursionError):
        raise UserError(f"{path} holds no relight network: give a file that relight's training wrote") from None


def load_network(path: Path | str, device: str | torch.device = "cpu") -> tuple[Network, dict[str, Any]]:
    """Reads a network.

    Args:
        path: .safetensors of a training, or .onnx of an export.
        device: of the weights.

    Returns:
        The network, float32 and in evaluation mode; and the values of its header: `size` in pixels, the settings
        `model`, with the defaults of those that a file of an older version lacks, and what else `save_network` was
        given.

    Raises:
        UserError: if the file does not exist, is neither safetensors nor .onnx, or holds no network of this version.
    """
    config = read_config(path)
    try:
        model, size = Model(**config["model"]), config["size"]
        if unset := [name for name, value in vars(model).items() if value == MISSING]:
            raise KeyError(f"model.{unset[0]} is missing")
        if not size <= MAX_SIZE:
            raise ValueError(f"its size is {size} px, and the maximum is {MAX_SIZE}")
        with torch.device("meta"):  # allocates no memory before the header's shapes are compared with the tensors
            network = build(model, size)
        weights = read_weights(Path(path), network)
        dtypes = {name: tensor.dtype for name, tensor in network.state_dict().items()}
        weights = {name: tensor.to(dtypes.get(name, tensor.dtype)) for name, tensor in weights.items()}
        network.load_state_dict(weights, assign=True)
    except (TypeError, KeyError, ValueError, RuntimeError, OverflowError, AttributeError, SafetensorError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise UserError(f"{path} does not fit this version of relight: {reason}") from None
    network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # not in torch's hints
    return network.eval(), {**config, "model": asdict(model)}


def read_weights(path: Path, network: Network) -> dict[str, torch.Tensor]:
    """Reads the weights of a file (.safetensors or .onnx) by their names in `network`.

    An .onnx file has the names with a prefix, and no counters of batch norm: they are 0.
    """
    if path.suffix != ".onnx":
        with safe_open(path, "pt") as file:
            return {name: file.get_tensor(name) for name in file.keys()}
    import onnx

    constants = {}
    for constant in onnx.load(path).graph.initializer:
        name = constant.name.removeprefix(PREFIX).removesuffix(HALF)
        constants[name] = torch.from_numpy(onnx.numpy_helper.to_array(constant).copy())
    names = dict(network.state_dict())
    counters = {name: torch.zeros((), dtype=torch.int64) for name in names if name.endswith("num_batches_tracked")}
    return counters | {name: values for name, values in constants.items() if name in names}


def save_state(path: Path, digest: str, parts: Parts, step: int, history: History) -> None:
    """Writes the state from which an interrupted training resumes, whole or not at all.

    Args:
        path: .pt.
        digest: the training's fingerprint.
        parts: modules and optimisers.
        step: steps done.
        history: rows of the log.
    """
    with atomic_write(path) as tmp:
        states = {name: part.state_dict() for name, part in parts.items()}
        with open(tmp, "wb") as file:  # with a path, torch.save would hide why a write failed
            torch.save({"settings": digest, "step": step, "history": history, **states}, file)


def restore_state(path: Path, digest: str, parts: Parts, device: torch.device) -> tuple[int, History, str]:
    """Loads the state of the same training, if it exists.

    Args:
        path: .pt.
        digest: the training's fingerprint; the state of another one is not loaded.
        parts: modules and optimisers, whose states are replaced.
        device: on which the tensors are loaded.

    Returns:
        The first step to do, 0 if nothing is loaded; the rows logged before; and a message about the file for the
        user, "" if there is no file.
    """
    if not path.exists():
        return 0, [], ""
    try:
        state = torch.load(path, map_location=device, weights_only=True)
        same = state["settings"] == digest
    except Exception as error:  # of pickle, zipfile or torch: the file was damaged after it was written
        return 0, [], f"{path} cannot be read ({type(error).__name__}): starting from the beginning"
    if not same:
        return 0, [], f"{path} belongs to other settings or data: starting from the beginning"
    for name, part in parts.items():
        part.load_state_dict(state[name])
    return state["step"], state["history"], f"going on from step {state['step']} ({path})"
