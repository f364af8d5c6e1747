"""Trains one network: a fixed number of steps on pairs that are relit on the fly.

All randomness is a function of (seed, step). So the weights, the optimiser's moments and the step are the whole state,
and a training that was killed at any moment ends with the same bytes.
"""

import copy
import csv
import hashlib
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.distributed as distributed
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from relight.config import Augment, Loss, Model, Train
from relight.files import UserError, atomic_write, existing_file
from relight.learning.augment import augmented
from relight.learning.checkpoint import load_network, restore, save_network, save_state
from relight.learning.data import Batch, RelitSet, generator, pairs, read_split
from relight.learning.losses import losses, weighted_sum, weights
from relight.learning.networks import STRIDE, Network, UNet, build
from relight.learning.validation import Validation
from relight.progress import duration

# Purposes of random numbers (`data.generator`); 0 orders the pairs.
STEP_DRAWS = 1
SUBSET = 2
PICTURE = 3
FLOOR = 0.02  # share of the learning rate at which the cosine ends


@dataclass(frozen=True)
class Recipe:
    """All settings of a training."""

    model: Model
    loss: Loss
    train: Train
    augment: Augment

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """All settings of the recipe by the name of their group."""
        return {part.name: asdict(getattr(self, part.name)) for part in fields(self)}


@dataclass(frozen=True)
class Inputs:
    """The files that a training reads, beside `train.start`."""

    packed: Path
    lights: Path
    split: Path


def fingerprint(recipe: Recipe, inputs: Inputs) -> str:
    """A hash of all settings, `train.version` among them, and of the content of all inputs, `train.start` included.

    Raises:
        UserError: if an input does not exist.
    """
    digest = hashlib.sha256(json.dumps(list(recipe.as_dict().values()), sort_keys=True).encode())
    start = recipe.train.start
    paths: list[Path | str] = [inputs.packed, inputs.lights, inputs.split, *([start] if start else [])]
    for path in paths:
        with open(existing_file(path, "training"), "rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def train(
    recipe: Recipe,
    inputs: Inputs,
    out: Path,
    state: Path,
    curve: Path | None = None,
    log: Callable[[dict[str, float], int], None] | None = None,
    show: Callable[[np.ndarray, int], None] | None = None,
) -> None:
    """Trains a network on `selection`, pairs of figures of the split and lights of the table.

    After every `train.epoch` steps it prints a line of progress, calls `show` and `log`, and writes `state`. The next
    call with the same recipe and inputs goes on from there; the state of another training is ignored, with a line that
    says so. The state stays at the end: the caller removes it once the outputs are safe.

    Under torchrun each process takes its share of the batch and the gradients are averaged. On a CPU the training keeps
    to one thread: its results then do not depend on the machine's load, and several trainings run side by side.

    Args:
        recipe: all settings.
        inputs: the files to train on.
        out: the network (.safetensors), written whole at the end.
        state: what an interrupted training goes on from.
        curve: all that was logged (.csv), a row per epoch, written whole at the end.
        log: receives the steps done and, by name, the means of the losses since the last call, the learning rate `lr`,
            and the losses on fixed pairs of the test as `validation/*`.
        show: receives a picture of what is inferred of these pairs, and the steps done.

    Raises:
        UserError: if the loss is not finite; it names the step, and the last good state stays.
    """
    settings = recipe.train
    with processes(settings) as (device, rank, world), torch_settings(device):
        data = RelitSet(inputs.packed, inputs.lights, recipe.model.order, settings.color, device)
        figures, lights = selection(data, inputs.split, settings)

        torch.manual_seed(settings.seed)
        network = start_network(recipe, data, inputs.packed).to(device)
        average = copy.deepcopy(network) if settings.average else None
        optimizer = make_optimizer(network, settings)
        parts: dict[str, nn.Module | torch.optim.Optimizer] = {"network": network, "optimizer": optimizer}
        if average:
            parts["average"] = average
        digest = fingerprint(recipe, inputs)
        first, history, found = restore(state, digest, parts, device)
        if found and rank == 0:
            say(found)

        forward: Callable[..., dict[str, Tensor]] = network
        if world > 1:
            forward = DistributedDataParallel(network)
        if settings.compile:
            forward = torch.compile(forward)
        autocast = torch.autocast(device.type, torch.bfloat16) if settings.precision == "bf16" else nullcontext()
        weight = weights(recipe.loss, network.size)
        validation = Validation(data, inputs.split, recipe.loss, network.size) if rank == 0 else None
        meter, began = Meter(device), time.monotonic()
        for step in range(first, settings.steps):
            batch = draw_batch(data, figures, lights, recipe, step, rank, world)
            for group in optimizer.param_groups:
                group["lr"] = learning_rate(settings, step)
            with autocast:
                outputs = forward(batch.image, batch.mask)
            outputs["light"] = outputs["light"] / batch.exposure[:, None, None]
            terms = losses(outputs, batch, recipe.loss)
            total = weighted_sum(terms, weight)
            optimizer.zero_grad(set_to_none=True)
            total.backward()
            optimizer.step()
            if average:
                update_average(average, network, min(settings.average, (1 + step) / (10 + step)))
            meter.add({"loss": total, **terms}, step)

            done = step + 1
            if done % settings.epoch and done < settings.steps:
                continue
            means = meter.means(world)
            if validation is None:  # of another process than the first
                continue
            seconds = (time.monotonic() - began) / (done - first)
            line = f"step {done}/{settings.steps}, loss {means['loss']:.4f}, {1e3 * seconds:.0f} ms a step"
            say(f"{line}, {duration(seconds * (settings.steps - done))} left")
            validated, picture = validation(average or network, drawn=show is not None)
            values = {**means, "lr": learning_rate(settings, step)}
            values |= {f"validation/{name}": value for name, value in validated.items()}
            if picture is not None and show:
                show(picture, done)
            if log:
                log(values, done)  # before the state: a state that is found again has been logged
            history.append({"step": done, **values})
            save_state(state, digest, parts, done, history)

        if rank == 0:
            kept: dict[str, Any] = {name: part for name, part in recipe.as_dict().items() if name != "model"}
            save_network(out, average or network, recipe.model, **kept, fingerprint=digest)
            if curve:
                write_curve(curve, history)


@contextmanager
def torch_settings(device: torch.device) -> Iterator[None]:
    """One thread on a CPU, the fastest algorithms on a GPU, and a random state of its own; restores all at the end."""
    threads, benchmark = torch.get_num_threads(), torch.backends.cudnn.benchmark
    if device.type == "cpu":
        torch.set_num_threads(1)
    torch.backends.cudnn.benchmark = True
    try:
        with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
            yield
    finally:
        torch.set_num_threads(threads)
        torch.backends.cudnn.benchmark = benchmark


@contextmanager
def processes(train: Train) -> Iterator[tuple[torch.device, int, int]]:
    """Yields device, rank and number of processes: one process alone, or one of torchrun's, joined to the others."""
    if train.device == "cuda" and not torch.cuda.is_available():
        raise UserError("train.device is cuda and torch sees no GPU here: give train.device=cpu or auto")
    kind = "cuda" if train.device != "cpu" and torch.cuda.is_available() else "cpu"
    world = int(os.environ.get("WORLD_SIZE", 1))
    if world == 1:
        yield torch.device(kind), 0, 1
        return
    if train.batch % world:
        raise UserError(
            f"train.batch {train.batch} does not divide among {world} processes: give a multiple of {world}"
        )
    device = torch.device(kind, int(os.environ["LOCAL_RANK"])) if kind == "cuda" else torch.device("cpu")
    if kind == "cuda":
        torch.cuda.set_device(device)
    distributed.init_process_group("nccl" if kind == "cuda" else "gloo")
    try:
        yield device, distributed.get_rank(), world
    finally:
        distributed.destroy_process_group()


def selection(data: RelitSet, split: Path, train: Train) -> tuple[np.ndarray, np.ndarray]:
    """Selects what to train on: figures of `train.part` of the split, and lights with the marks `train.lights`.

    With `train.figures` N, the figures are the first N of an order drawn from the seed, so that fewer are part of more.

    Returns:
        Indices of the figures' maps, those of all their views and outfits included, and indices of the lights.

    Raises:
        UserError: if nothing is left.
    """
    figures = data.figures(read_split(split)[train.part])
    lights = np.flatnonzero(np.isin(data.light_split, train.lights))
    if not len(figures) or not len(lights):
        raise UserError(f"{len(figures)} figures and {len(lights)} lights to train on: at least one of each is needed")
    if train.figures:
        if train.figures > len(figures):
            say(f"train.figures={train.figures}: there are {len(figures)}, and all of them are trained on")
        first = generator(train.seed, 0, SUBSET).permutation(len(figures))[: train.figures]
        figures = figures[np.sort(first)]
    return np.concatenate([figures, data.others(figures)]), lights


def start_network(recipe: Recipe, data: RelitSet, packed: Path) -> Network:
    """The network at step 0: new, or that of `train.start`.

    With `train.only=encoder` all other parts keep their weights and running statistics.

    Raises:
        UserError: if the size does not fit the maps, or `train.start` not the network.
    """
    settings = recipe.train
    size = settings.size or data.size
    if size > data.size:
        raise UserError(f"train.size={size}: the maps of {packed} have {data.size} px, give at most that")
    network = build(recipe.model, size).train()
    if not settings.start:
        if settings.only:
            raise UserError(f"train.only={settings.only} needs train.start=<the network whose other parts stay>")
        return network
    found, config = load_network(settings.start)
    given, wanted = {"size": config["size"], **config["model"]}, {"size": network.size, **asdict(recipe.model)}
    if isinstance(network, UNet) and min(network.size, config["size"]) > STRIDE:  # its layers fit every size
        given["size"] = network.size
    if {given["albedo"], wanted["albedo"]} == {"clip", "straight_through"}:  # they have the same values
        given["albedo"] = wanted["albedo"]
    if other := [key for key in wanted if given[key] != wanted[key]]:
        theirs, ours = (", ".join(f"{key}={values[key]}" for key in other) for values in (given, wanted))
        raise UserError(f"train.start={settings.start} is a network with {theirs}: give one with {ours}")
    network.load_state_dict(found.state_dict())
    if settings.only == "encoder":
        for name, part in network.named_children():
            if name != "encoder":
                part.requires_grad_(False).eval()
    return network


def make_optimizer(network: nn.Module, train: Train) -> torch.optim.Optimizer:
    """Adam as in the paper, or AdamW, whose decay spares norms and biases."""
    common: dict[str, Any] = {"lr": train.lr, "betas": (train.beta1, train.beta2), "fused": True}
    learned = [p for p in network.parameters() if p.requires_grad]
    if train.optimizer == "adam":
        return torch.optim.Adam(learned, **common)
    kernels = [p for p in learned if p.ndim > 1]
    others = [p for p in learned if p.ndim <= 1]
    return torch.optim.AdamW(
        [{"params": kernels, "weight_decay": train.decay}, {"params": others, "weight_decay": 0.0}], **common
    )


def learning_rate(train: Train, step: int) -> float:
    """The learning rate of `step`: a linear warm-up, then constant or half a cosine down to 2 %."""
    warm = min(1.0, (step + 1) / train.warmup) if train.warmup else 1.0
    if train.schedule == "constant":
        return train.lr * warm
    return train.lr * warm * (FLOOR + (1 - FLOOR) * 0.5 * (1 + math.cos(math.pi * step / train.steps)))


def draw_batch(
    data: RelitSet, figures: np.ndarray, lights: np.ndarray, recipe: Recipe, step: int, rank: int, world: int
) -> Batch:
    """The batch of a step, or this process's share of it; it also seeds torch for the dropout of the step."""
    settings = recipe.train
    chosen = pairs(settings.seed, step, settings.batch, len(figures), len(lights), settings.pairs)
    rng = generator(settings.seed, step, STEP_DRAWS)
    torch.manual_seed(int(rng.integers(2**62)) + rank)
    mirror = rng.random(settings.batch) < 0.5
    mine = slice(rank, None, world)
    figure, light = figures[chosen[mine, 0]], lights[chosen[mine, 1]]
    batch = data.batch(figure, light, mirror=mirror[mine] if settings.mirror else None)
    batch = replace(batch, scope=float(data.counts[figures[chosen[:, 0]]].sum()) / world)
    numbers = range(step * settings.batch, (step + 1) * settings.batch)[mine]
    generators = [generator(settings.seed, number, PICTURE) for number in numbers]
    return augmented(batch, recipe.augment, generators, settings.size or data.size)


@torch.no_grad()
def update_average(average: nn.Module, network: nn.Module, decay: float) -> None:
    """average = decay * average + (1 - decay) * network; buffers are copied."""
    torch._foreach_lerp_(list(average.parameters()), list(network.parameters()), 1 - decay)
    for mine, other in zip(average.buffers(), network.buffers()):
        mine.copy_(other)


class Meter:
    """Means of the losses over an epoch, summed on the device, so that no step waits for a number."""

    def __init__(self, device: torch.device):
        self.device = device
        self.clear()

    def clear(self) -> None:
        """Forgets all values."""
        self.names: list[str] = []
        self.sums, self.steps = torch.zeros((), device=self.device), 0
        self.bad = torch.tensor(torch.inf, device=self.device)

    def add(self, values: dict[str, Tensor], step: int) -> None:
        """Adds the losses of a step; no value leaves the device."""
        row = torch.stack([value.detach() for value in values.values()])
        self.names, self.sums, self.steps = list(values), self.sums + row, self.steps + 1
        self.bad = torch.where(row[0].isfinite(), self.bad, self.bad.clamp_max(step))

    def means(self, world: int) -> dict[str, float]:
        """The means over steps and processes since the last call.

        Raises:
            UserError: if a loss was not finite; it names the first such step.
        """
        if world > 1:
            distributed.all_reduce(self.sums)
            distributed.all_reduce(self.bad, op=distributed.ReduceOp.MIN)
        means, bad = (self.sums / (self.steps * world)).tolist(), self.bad.item()
        if bad < math.inf:
            raise UserError(
                f"the loss is not a finite number at step {int(bad)}: the last good state is kept; try a lower train.lr"
            )
        names = self.names
        self.clear()
        return dict(zip(names, means))


def say(line: str) -> None:
    """Prints a line to stderr, where logs of jobs are read."""
    print(line, file=sys.stderr, flush=True)


def write_curve(path: Path, history: list[dict[str, float]]) -> None:
    """The log as CSV: step, total and each named loss, learning rate, and the losses on the validation's pairs."""
    with atomic_write(path) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.DictWriter(file, list(history[-1]))
        writer.writeheader()
        writer.writerows(history)
