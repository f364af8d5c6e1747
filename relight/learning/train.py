"""Trains one network: a fixed number of steps on pairs that are relit on the fly.

All random numbers are a function of (seed, step). So the whole state consists of the weights, the optimiser's moments
and the step, and an interrupted training that resumes ends with the same bytes.
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
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.distributed as distributed
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from relight.core.errors import UserError
from relight.core.files import atomic_write, existing_file, file_hash
from relight.core.progress import duration
from relight.learning.augment import augment_batch
from relight.learning.checkpoint import History, Parts, load_network, restore_state, save_network, save_state
from relight.learning.data import Batch, RelitSet, choose_device, draw_pairs, generator, read_split
from relight.learning.losses import losses
from relight.learning.networks import STRIDE, Network, UNet, build, widened
from relight.learning.optimizers import make_optimizers
from relight.learning.validation import Validation
from relight.settings import Augment, Loss, Model, Train
from relight.settings.schema import fields_by_key
from relight.settings.setting import setting_of

# Purposes of random numbers, as for `data.generator`; purpose 0 is the order of the pairs.
STEP_DRAWS = 1
SUBSET = 2
AUGMENTATION = 3
Log = Callable[[dict[str, float], int, np.ndarray | None], None]
FINAL_LR = 0.02  # learning rate at the end of the cosine schedule, over train.lr


@dataclass(frozen=True)
class Recipe:
    """All settings of a training.

    Attributes:
        model: settings of the network.
        loss: weights and reduction.
        train: steps, optimiser, data and precision.
        augment: strengths of the augmentation.
    """

    model: Model
    loss: Loss
    train: Train
    augment: Augment


@dataclass(frozen=True)
class Inputs:
    """The input files of a training, apart from `train.start`.

    Attributes:
        packed: packed maps (.safetensors).
        lights: light set (.npz).
        split: names of figures by part (.json).
        code: hash of the training's code, if the workflow records it.
    """

    packed: Path
    lights: Path
    split: Path
    code: str = ""


def fingerprint(recipe: Recipe, inputs: Inputs) -> str:
    """Returns a hash of all settings, of all input files, including `train.start`, and the recorded hash of the code.

    Raises:
        UserError: if an input does not exist.
    """
    digest = hashlib.sha256(json.dumps([*asdict(recipe).values(), inputs.code], sort_keys=True).encode())
    paths: list[Path | str] = [inputs.packed, inputs.lights, inputs.split, *filter(None, [recipe.train.start])]
    for path in paths:
        digest.update(bytes.fromhex(file_hash(existing_file(path, "training"))))
    return digest.hexdigest()


def train(
    recipe: Recipe, inputs: Inputs, out: Path, state: Path, curve: Path | None = None, log: Log | None = None
) -> None:
    """Trains a network on `select_training_data`, pairs of figures of the split and lights of the table.

    After every `train.epoch` steps it prints a line of progress, calls `log`, and writes `state`. The next call with
    the same recipe and inputs resumes from there; it ignores the state of another training and prints a message. The
    caller removes the state after the outputs are stored.

    Under torchrun each process takes its share of the batch, and the gradients are averaged. On a CPU the training uses
    one thread, or as many as OMP_NUM_THREADS says, so several trainings can run in parallel.

    Args:
        recipe: all settings.
        inputs: the files to train on.
        out: the network (.safetensors), written whole at the end.
        state: the state from which an interrupted training resumes (.pt).
        curve: all logged values (.csv), a row per epoch, written whole at the end.
        log: receives values by name, the steps done, and a picture of `Validation` or None. The values are the means of
            the losses since the last call, the learning rate `lr`, and the losses on its pairs as `validation/*`.

    Raises:
        UserError: if the loss is not finite; it names the step, and the last good state stays.
    """
    settings = recipe.train
    with distributed_process(settings) as (device, rank, world), torch_context(device):
        data = RelitSet(inputs.packed, inputs.lights, recipe.model.order, settings.color, device)
        figures, lights = select_training_data(data, inputs.split, settings)

        torch.manual_seed(settings.seed)
        network = _initial_network(recipe, data, inputs.packed).to(device)
        average = copy.deepcopy(network) if settings.average else None
        optimizers = make_optimizers(network, settings)
        parts: Parts = {"network": network, **optimizers, **({"average": average} if average else {})}
        digest = fingerprint(recipe, inputs)
        first, history, message = restore_state(state, digest, parts, device)
        if message and rank == 0:
            _print_line(message)
        if settings.precision == "bf16" and not _multiplies_bfloat16(device) and rank == 0:
            _print_line("this CPU has no instructions for bfloat16: train.precision=f32 is several times as fast here")

        forward: Callable[..., dict[str, Tensor]] = network
        if world > 1:
            taught = (setting_of(field).teaches for key, field in fields_by_key(Loss) if getattr(recipe.loss, key))
            some_unused = bool({"albedo", "transport", "light"}.difference(*taught))
            forward = DistributedDataParallel(network, find_unused_parameters=some_unused)
        if settings.compile:
            forward = torch.compile(forward)
        autocast = torch.autocast(device.type, torch.bfloat16) if settings.precision == "bf16" else nullcontext()
        validation = Validation(data, inputs.split, recipe.loss, network.size) if rank == 0 else None
        meter, began = Meter(device), time.monotonic()
        for step in range(first, settings.steps):
            batch = draw_batch(data, figures, lights, recipe, step, rank, world)
            for group in chain.from_iterable(optimizer.param_groups for optimizer in optimizers.values()):
                group["lr"] = learning_rate(settings, step) * group.get("factor", 1.0)
            with autocast:
                outputs = forward(batch.image, batch.mask)
            outputs["light"] = outputs["light"] / batch.exposure[:, None, None]
            total, terms = losses(outputs, batch, recipe.loss)
            for optimizer in optimizers.values():
                optimizer.zero_grad()
            total.backward()
            for optimizer in optimizers.values():
                optimizer.step()
            if average:
                update_average(average, network, min(settings.average, (1 + step) / (10 + step)))
            meter.add({"loss": total, **terms}, step)

            done = step + 1
            if done % settings.epoch and done < settings.steps:
                continue
            means, meter = meter.means(world), Meter(device)
            if validation is None:  # only the first process logs
                continue
            seconds = (time.monotonic() - began) / (done - first)
            line = f"step {done}/{settings.steps}, loss {means['loss']:.4f}, {1e3 * seconds:.0f} ms a step"
            _print_line(f"{line}, {duration(seconds * (settings.steps - done))} left")
            validated, picture = validation(average or network, drawn=log is not None)
            values = {**means, "lr": learning_rate(settings, step)}
            values |= {f"validation/{name}": value for name, value in validated.items()}
            if log:
                log(values, done, picture)  # before save_state: all steps of a restored state have been logged
            history.append({"step": done, **values})
            save_state(state, digest, parts, done, history)

        if rank == 0:
            kept: dict[str, Any] = {name: part for name, part in asdict(recipe).items() if name != "model"}
            save_network(out, average or network, recipe.model, **kept, fingerprint=digest)
            if curve:
                write_curve(curve, history)


@contextmanager
def torch_context(device: torch.device) -> Iterator[None]:
    """Sets the threads of a CPU, cuDNN's benchmark mode and a separate random state; restores them at the end."""
    threads, benchmark = torch.get_num_threads(), torch.backends.cudnn.benchmark
    if device.type == "cpu" and "OMP_NUM_THREADS" not in os.environ:  # Snakemake and torchrun set it
        torch.set_num_threads(1)
    torch.backends.cudnn.benchmark = True
    try:
        with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
            yield
    finally:
        torch.set_num_threads(threads)
        torch.backends.cudnn.benchmark = benchmark


def _multiplies_bfloat16(device: torch.device) -> bool:
    """Returns whether a device multiplies bfloat16 in hardware: a GPU, or a CPU with AMX, AVX-512 BF16 or Arm's."""
    told = getattr(torch.cpu, "get_capabilities", None)  # not by older versions of torch
    return device.type != "cpu" or not told or any(map(told().get, ("amx_bf16", "avx512_bf16", "bf16")))


@contextmanager
def distributed_process(train: Train) -> Iterator[tuple[torch.device, int, int]]:
    """Joins the process group, if torchrun started several processes.

    Yields:
        The device of this process, its rank from 0, and the number of processes; rank 0 of 1 without torchrun.

    Raises:
        UserError: if there is no GPU for `train.device=cuda`, or the batch cannot be divided among the processes.
    """
    device, world = choose_device(train.device), int(os.environ.get("WORLD_SIZE", 1))
    if world == 1:
        yield device, 0, 1
        return
    if train.batch % world:
        raise UserError(
            f"train.batch={train.batch} is not divisible by the {world} processes: give a multiple of {world}"
        )
    if device.type == "cuda":
        device = torch.device("cuda", int(os.environ["LOCAL_RANK"]))
        torch.cuda.set_device(device)
    distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield device, distributed.get_rank(), world
    finally:
        distributed.destroy_process_group()


def select_training_data(data: RelitSet, split: Path, train: Train) -> tuple[np.ndarray, np.ndarray]:
    """Selects the training data: figures of `train.part` of the split, and lights whose split is in `train.lights`.

    With `train.figures` N, the figures are the first N of an order drawn from the seed: a smaller set is a subset of a
    larger one.

    Args:
        data: all figures and lights.
        split: file with the names of the figures by part (.json).
        train: settings.

    Returns:
        Indices of the figures' maps, those of all their views and outfits included, and indices of the lights.

    Raises:
        UserError: if no figure or no light is left.
    """
    figures = data.figures(read_split(split)[train.part])
    lights = np.flatnonzero(np.isin(data.light_split, train.lights))
    if not len(figures) or not len(lights):
        raise UserError(
            f"there are {len(figures)} figures and {len(lights)} lights to train on: at least one of each is needed"
        )
    if train.figures:
        if train.figures > len(figures):
            _print_line(f"train.figures={train.figures}, but there are {len(figures)} figures: training on all of them")
        first = generator(train.seed, 0, SUBSET).permutation(len(figures))[: train.figures]
        figures = figures[np.sort(first)]
    return np.concatenate([figures, data.other_views(figures)]), lights


def _initial_network(recipe: Recipe, data: RelitSet, packed: Path) -> Network:
    """Returns the network at step 0, in training mode: a new one, or that of `train.start`.

    A U-Net's `train.start` may be of a lower order: the further bands are then zero at first. With `train.only=encoder`
    all parts except the encoder are frozen, including their running statistics. Raises UserError if the size is larger
    than that of the maps, or `train.start` has other model settings.
    """
    settings = recipe.train
    size = settings.size or data.size
    if size > data.size:
        raise UserError(f"train.size={size} is larger than the maps of {packed}: give at most {data.size}")
    network = build(recipe.model, size).train()
    if not settings.start:
        return network
    start, start_config = load_network(settings.start)
    start_settings = {"size": start_config["size"], **start_config["model"]}
    new_settings = {"size": network.size, **asdict(recipe.model)}
    start_settings |= {key: new_settings[key] for key in ("dropout", "rescale", "rebalance")}  # shape no weights
    if isinstance(network, UNet):
        # It is convolutional: its weights fit every size above one pixel at the bottleneck.
        if min(network.size, start_config["size"]) > STRIDE:
            start_settings["size"] = network.size
        start_settings["order"] = max(start.order, network.order)
    # Both have the same outputs; only their gradients differ.
    if {start_settings["albedo"], new_settings["albedo"]} == {"clip", "straight_through"}:
        start_settings["albedo"] = new_settings["albedo"]
    if other := [key for key in new_settings if start_settings[key] != new_settings[key]]:
        theirs, ours = (", ".join(f"{key}={values[key]}" for key in other) for values in (start_settings, new_settings))
        raise UserError(f"train.start={settings.start} is a network with {theirs}: give one with {ours}")
    weights = start.state_dict()
    network.load_state_dict(widened(weights, network) if isinstance(network, UNet) else weights)
    if settings.only == "encoder":
        for name, part in network.named_children():
            if name != "encoder":
                part.requires_grad_(False).eval()
    return network


def learning_rate(train: Train, step: int) -> float:
    """Returns the learning rate of a step, counted from 0: linear warm-up, then constant or a cosine to FINAL_LR.

    `train` has the largest rate, the schedule and the numbers of steps.
    """
    warm = min(1.0, (step + 1) / train.warmup) if train.warmup else 1.0
    if train.schedule == "constant":
        return train.lr * warm
    first, last = train.span
    done = first + (last - first) * step / train.steps
    return train.lr * warm * (FINAL_LR + (1 - FINAL_LR) * 0.5 * (1 + math.cos(math.pi * done)))


def draw_batch(
    data: RelitSet, figures: np.ndarray, lights: np.ndarray, recipe: Recipe, step: int, rank: int, world: int
) -> Batch:
    """Draws the batch of a step, or this process's share of it; also seeds torch for the dropout of the step.

    Args:
        data: figures and lights.
        figures: indices of the figures' maps to train on.
        lights: indices of the lights to train on.
        recipe: all settings.
        step: from 0.
        rank: of this process, from 0. It takes every `world`-th pair of the step.
        world: number of processes.

    Returns:
        Augmented pairs (train.batch / world of them), a function of the seed, the step and the rank.
    """
    settings = recipe.train
    chosen = draw_pairs(settings.seed, step, settings.batch, len(figures), len(lights), settings.pairs)
    rng = generator(settings.seed, step, STEP_DRAWS)
    torch.manual_seed(int(rng.integers(2**62)) + rank)
    mirror = rng.random(settings.batch) < 0.5
    local = slice(rank, None, world)
    figure, light = figures[chosen[local, 0]], lights[chosen[local, 1]]
    batch = data.batch(figure, light, mirror=mirror[local] if settings.mirror else None)
    batch = replace(batch, mask_pixels=float(data.counts[figures[chosen[:, 0]]].sum()) / world)
    if recipe.loss.relit and len(figure) == 1:  # the batch has no other light
        others = lights[rng.integers(len(lights), size=settings.batch)]
        batch = replace(batch, other_light=data.lights[others[local]][:, : batch.light.shape[1]])
    numbers = range(step * settings.batch, (step + 1) * settings.batch)[local]
    generators = [generator(settings.seed, number, AUGMENTATION) for number in numbers]
    augmented = augment_batch(batch, recipe.augment, generators, settings.size or data.size)
    if augmented is not batch and distributed.is_initialized():  # every process divides by the mean over all
        pixels = torch.tensor(augmented.mask_pixels, device=augmented.mask.device)
        distributed.all_reduce(pixels)
        augmented = replace(augmented, mask_pixels=float(pixels) / world)
    return augmented


@torch.no_grad()
def update_average(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Updates the exponential moving average of the weights: average = decay * average + (1 - decay) * network.

    Buffers are copied.
    """
    torch._foreach_lerp_(list(average.parameters()), list(network.parameters()), 1 - decay)
    for averaged, current in zip(average.buffers(), network.buffers()):
        averaged.copy_(current)


class Meter:
    """Means of the losses over an epoch, summed on the device to avoid a synchronisation in each step.

    Attributes:
        names, sums: of the losses, on the device.
        steps: added so far.
        first_nonfinite: the first step whose total was not finite, infinity if there is none.
    """

    def __init__(self, device: torch.device):
        self.names: list[str] = []
        self.sums, self.steps = torch.zeros((), device=device), 0
        self.first_nonfinite = torch.tensor(torch.inf, device=device)

    def add(self, values: dict[str, Tensor], step: int) -> None:
        """Adds the losses of a step without a transfer from the device."""
        row = torch.stack([value.detach() for value in values.values()])
        self.names, self.sums, self.steps = list(values), self.sums + row, self.steps + 1
        self.first_nonfinite = torch.where(
            row[0].isfinite(), self.first_nonfinite, self.first_nonfinite.clamp_max(step)
        )

    def means(self, world: int) -> dict[str, float]:
        """Returns the means over steps and processes.

        Args:
            world: number of processes.

        Raises:
            UserError: if a loss was not finite; it names the first such step.
        """
        if world > 1:
            distributed.all_reduce(self.sums)
            distributed.all_reduce(self.first_nonfinite, op=distributed.ReduceOp.MIN)
        means, nonfinite_step = (self.sums / (self.steps * world)).tolist(), self.first_nonfinite.item()
        if nonfinite_step < math.inf:
            raise UserError(
                f"the loss is not a finite number at step {int(nonfinite_step)}: the last good state is kept; "
                "try a lower train.lr"
            )
        return dict(zip(self.names, means))


def _print_line(line: str) -> None:
    """Prints a line to stderr, which the logs of jobs contain."""
    print(line, file=sys.stderr, flush=True)


def write_curve(path: Path, history: History) -> None:
    """Writes the log as CSV: step, total and each named loss, learning rate, and the losses on the validation pairs."""
    with atomic_write(path) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.DictWriter(file, list(history[-1]))
        writer.writeheader()
        writer.writerows(history)
