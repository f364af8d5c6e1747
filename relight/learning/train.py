"""Trains one network: a fixed number of steps, each relit on the fly; killed at any moment it goes on bit by bit.

All randomness is a function of (seed, step), so the state file needs no generators and no place in the data: the
weights, the optimiser's moments and the step are enough.
"""

import copy
import csv
import math
import os
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
import torch.distributed as distributed
from torch import nn
from torch.nn.parallel import DistributedDataParallel

from relight.config import Augment, Loss, Model, Train
from relight.files import UserError, whole
from relight.learning.augment import augmented
from relight.learning.checkpoint import load_network, save_network
from relight.learning.data import Batch, RelitSet, read_split
from relight.learning.losses import losses, weights
from relight.learning.meter import Meter
from relight.learning.networks import STRIDE, Network, UNet, build
from relight.learning.pairs import generator, pairs
from relight.learning.state import fingerprint, restore, save_state
from relight.progress import span

STEP_DRAWS = 1  # the purpose of the random numbers of a step, apart from those that order the pairs
SUBSET = 2  # of those that choose `train.figures`
PICTURE = 3  # of those that augment a picture
FLOOR = 0.02  # share of the learning rate at which the cosine ends


def train(
    model: Model,
    loss: Loss,
    train: Train,
    augment: Augment,
    packed: Path,
    lights: Path,
    split: Path,
    out: Path,
    state: Path,
    curve: Path | None = None,
    log: Callable[[dict[str, float], int], None] | None = None,
) -> None:
    """Trains on `material`, figures of the split and lights of the table; writes the network to `out` (safetensors).

    After every `train.epoch` steps: a line of progress, `log(means of the losses since the last time, steps done)`,
    then the state to `state`. The next call with the same settings and data goes on from there; a state of other
    settings is ignored, with a line that says so. `curve` (CSV) gets all that was logged, a row per epoch. Both
    outputs are written whole at the end. The state stays: the caller removes it when it has the outputs safe.

    Under torchrun each process takes its share of the batch and the gradients are averaged. On a CPU the training keeps
    to one thread: results then do not depend on the machine's load, and several trainings run side by side.

    Raises UserError when the loss is no longer a finite number, naming the step; the last good state is kept.
    """
    with processes(train) as (device, rank, world):
        if device.type == "cpu":
            torch.set_num_threads(1)
        torch.backends.cudnn.benchmark = True
        data = RelitSet(packed, lights, model.order, train.color, device)
        chosen, lit = material(data, split, train)

        torch.manual_seed(train.seed)
        size = train.size or data.size
        if size > data.size:
            raise UserError(f"train.size={size}: the maps of {packed} have {data.size} px, give at most that")
        network = build(model, size).to(device).train()
        if train.start:
            adopt(network, model, train)
        elif train.only:
            raise UserError(f"train.only={train.only} needs train.start=<the network whose other parts stay>")
        average = copy.deepcopy(network) if train.average else None
        optimizer = make_optimizer(network, train)
        parts = {"network": network, "optimizer": optimizer} | ({"average": average} if average else {})
        digest = fingerprint(model, loss, train, augment, packed, lights, split)
        first, history, found = restore(state, digest, parts, device)
        if found and rank == 0:
            say(found)

        forward: nn.Module = network
        if world > 1:
            forward = DistributedDataParallel(forward)
        if train.compile:
            forward = torch.compile(forward)
        autocast = torch.autocast(device.type, torch.bfloat16) if train.precision == "bf16" else nullcontext()
        weight = weights(loss, size)
        meter, start = Meter(device), time.monotonic()
        for step in range(first, train.steps):
            batch = draw(data, chosen, lit, train, augment, step, rank, world)
            for group in optimizer.param_groups:
                group["lr"] = rate(train, step)
            with autocast:
                outputs = forward(batch.image, batch.mask)
            outputs["light"] = outputs["light"] / batch.exposure[:, None, None]
            values = losses(outputs, batch, loss)
            values = {"loss": sum(weight[name] * value for name, value in values.items()), **values}
            optimizer.zero_grad(set_to_none=True)
            values["loss"].backward()
            optimizer.step()
            if average:
                follow(average, network, min(train.average, (1 + step) / (10 + step)))
            meter.add(values, step)

            done = step + 1
            if done % train.epoch and done < train.steps:
                continue
            means = meter.means(world)
            if rank:
                continue
            seconds = (time.monotonic() - start) / (done - first)
            line = f"step {done}/{train.steps}, loss {means['loss']:.4f}, {1e3 * seconds:.0f} ms a step"
            say(f"{line}, {span(seconds * (train.steps - done))} left")
            if log:
                log(means, done)  # before the state: a state that is found again has been logged
            history.append({"step": done, "lr": rate(train, step), **means})
            save_state(state, digest, parts, done, history)

        if rank == 0:
            settings = {"loss": asdict(loss), "train": asdict(train), "augment": asdict(augment), "fingerprint": digest}
            save_network(out, average or network, model, **settings)
            if curve:
                write_curve(curve, history)


@contextmanager
def processes(train: Train):
    """Yields (device, rank, world size): one process alone, or one of torchrun's, joined to the others."""
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


def material(data: RelitSet, split: Path, train: Train) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the maps and of the lights to train on: figures of `train.part` of the split, in all looks that the
    set has of them, and the marks `train.lights`.

    With `train.figures` N, the first N of an order drawn from the seed, so that fewer are part of more.
    Raises UserError when nothing is left.
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


def adopt(network: Network, model: Model, train: Train) -> None:
    """Takes over the weights of `train.start`; with `only: encoder` all others stay, running statistics included.

    Raises UserError when that network is of another kind, or of another size that its layers depend on.
    """
    found, config = load_network(train.start)
    wanted = {"size": network.size, "model": asdict(model)}
    if isinstance(network, UNet) and min(network.size, config["size"]) > STRIDE:  # one pixel has no norms
        del wanted["size"]
    if (made := {key: config[key] for key in wanted}) != wanted:
        raise UserError(f"train.start={train.start} is a network of {made}: it must be one of {wanted}")
    network.load_state_dict(found.state_dict())
    if train.only == "encoder":
        for name, part in network.named_children():
            if name != "encoder":
                part.requires_grad_(False).eval()


def make_optimizer(network: nn.Module, train: Train) -> torch.optim.Optimizer:
    """Adam as in the paper, or AdamW, whose decay spares norms and biases."""
    common = {"lr": train.lr, "betas": (train.beta1, train.beta2), "fused": True}
    learned = [p for p in network.parameters() if p.requires_grad]
    if train.optimizer == "adam":
        return torch.optim.Adam(learned, **common)
    kernels = [p for p in learned if p.ndim > 1]
    others = [p for p in learned if p.ndim <= 1]
    return torch.optim.AdamW(
        [{"params": kernels, "weight_decay": train.decay}, {"params": others, "weight_decay": 0.0}], **common
    )


def rate(train: Train, step: int) -> float:
    """The learning rate of `step`: a linear warm-up, then constant or half a cosine down to 2 %."""
    warm = min(1.0, (step + 1) / train.warmup) if train.warmup else 1.0
    if train.schedule == "constant":
        return train.lr * warm
    return train.lr * warm * (FLOOR + (1 - FLOOR) * 0.5 * (1 + math.cos(math.pi * step / train.steps)))


def draw(
    data: RelitSet,
    figures: np.ndarray,
    lights: np.ndarray,
    train: Train,
    augment: Augment,
    step: int,
    rank: int,
    world: int,
) -> Batch:
    """The batch of one step, or this process's share of it; also seeds torch, for the dropout of this step."""
    chosen = pairs(train.seed, step, train.batch, len(figures), len(lights), train.pairs)
    rng = generator(train.seed, step, STEP_DRAWS)
    torch.manual_seed(int(rng.integers(2**62)) + rank)
    mirror = rng.random(train.batch) < 0.5
    mine = slice(rank, None, world)
    batch = data.batch(figures[chosen[mine, 0]], lights[chosen[mine, 1]], mirror=mirror[mine] if train.mirror else None)
    batch = replace(batch, scope=float(data.counts[figures[chosen[:, 0]]].sum()) / world)
    numbers = range(step * train.batch, (step + 1) * train.batch)[mine]
    generators = [generator(train.seed, number, PICTURE) for number in numbers]
    return augmented(batch, augment, generators, train.size or data.size)


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, decay: float) -> None:
    """average = decay * average + (1 - decay) * network; buffers are copied."""
    torch._foreach_lerp_(list(average.parameters()), list(network.parameters()), 1 - decay)
    for mine, other in zip(average.buffers(), network.buffers()):
        mine.copy_(other)


def say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def write_curve(path: Path, history: list[dict]) -> None:
    """The log as CSV: step, learning rate, total and each named loss."""
    with whole(path) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.DictWriter(file, list(history[0]))
        writer.writeheader()
        writer.writerows(history)
