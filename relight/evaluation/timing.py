"""How long a network takes for a picture (paper, section 1: .43 s at 1024 px), and what the machine could do."""

import csv
import os
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from functools import partial
from pathlib import Path

import torch
from torch.utils.flop_counter import FlopCounterMode

from relight.config import Model, Timing
from relight.files import UserError, existing, whole
from relight.learning.networks import build
from relight.progress import progress

TYPES = {"f32": torch.float32, "bf16": torch.bfloat16}
PRINTED = 0.43  # seconds for a picture of 1024 px, on a GeForce GTX 1080 Ti


@dataclass
class Time:
    """One network at one size, batch 1, float32. wall, cpu: seconds for a picture; cpu counts all threads, 0 on a GPU.

    gflop: two operations per multiply-add; rate: GFLOP/s of a large matrix product on the same threads or GPU.
    """

    row: str
    width: float
    parameters: int
    size: int
    device: str
    threads: int
    wall: float
    cpu: float
    gflop: float
    rate: float

    @property
    def share(self) -> float:
        """Of the matrix rate that the network reaches, in wall time."""
        return self.gflop / self.wall / self.rate


def matmul_rate(clock: Callable[[Callable[[], object]], float], device: str, precision: str) -> float:
    """Operations per second of a large square matrix product; clock: call -> seconds."""
    side = 8192 if device == "cuda" else 2048
    a = torch.randn(side, side, device=device, dtype=TYPES[precision])
    return 2 * side**3 / clock(lambda: a @ a)


def multiply_adds(model: Model, size: int) -> float:
    """Of the network forward, for one image."""
    with torch.device("meta"):
        network, image, mask = build(model, size), torch.empty(1, 3, size, size), torch.empty(1, 1, size, size)
    with FlopCounterMode(display=False) as counter:
        network(image, mask)
    return counter.get_total_flops() / 2


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def wall(call: Callable[[], object], device: str, seconds: float) -> float:
    """Least wall seconds of a call."""
    return least(call, device, seconds)[0]


def least(call: Callable[[], object], device: str, seconds: float) -> tuple[float, float]:
    """Least wall and CPU seconds of a call in about `seconds`, three calls at least after one that does not count.

    It is the least because other work of the machine adds to the rest. On a GPU a call has ended when its work has.
    """
    walls, processors = [], []
    call()
    until = time.perf_counter() + seconds
    while len(walls) < 3 or time.perf_counter() < until:
        start, busy = time.perf_counter(), time.process_time()
        call()
        if device == "cuda":
            torch.cuda.synchronize()
        walls.append(time.perf_counter() - start)
        processors.append(time.process_time() - busy)
    return min(walls), min(processors)


def time_networks(models: dict[str, Model], settings: Timing, out: Path) -> None:
    """Times each model (row -> settings) at each of `settings.sizes`, on one thread, on all, and on a GPU where there
    is one, and writes the Times (CSV). Weights are untrained: they take no part in how long a network needs."""
    before, all_of_them = torch.get_num_threads(), cores()
    places = [("cpu", 1)] + [("cpu", all_of_them)] * (all_of_them > 1) + [("cuda", 1)] * torch.cuda.is_available()
    found: list[Time] = []
    try:
        for device, threads in places:
            torch.set_num_threads(threads)
            rate = matmul_rate(partial(wall, device=device, seconds=settings.seconds), device, "f32") / 1e9
            cases = [(row, size) for row in models for size in settings.sizes]
            for row, size in progress(cases, f"networks timed on {device}, threads {threads}"):
                found.append(timed(row, models[row], size, device, threads, rate, settings.seconds))
    finally:
        torch.set_num_threads(before)
    with whole(out) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(Time)])
        writer.writerows([f"{v:.6g}" if isinstance(v, float) else v for v in astuple(one)] for one in found)


@torch.inference_mode()
def timed(row: str, model: Model, size: int, device: str, threads: int, rate: float, seconds: float) -> Time:
    """One Time; rate: that of matrix products, GFLOP/s."""
    network = build(model, size).to(device).eval()
    image = torch.rand(1, 3, size, size, device=device).contiguous(memory_format=torch.channels_last)
    mask = torch.ones(1, 1, size, size, device=device)
    taken, busy = least(lambda: network(image, mask), device, seconds)
    return Time(
        row=row,
        width=model.width,
        parameters=sum(p.numel() for p in network.parameters()),
        size=size,
        device=device,
        threads=threads,
        wall=taken,
        cpu=0.0 if device == "cuda" else busy,
        gflop=2 * multiply_adds(model, size) / 1e9,
        rate=rate,
    )


def read_times(path: Path) -> list[Time]:
    """What `time_networks` wrote. UserError on another file."""
    with open(existing(path, "times"), newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows or list(rows[0]) != [field.name for field in fields(Time)]:
        raise UserError(f"{path} is not a table of times, as relight-inference-time writes it")
    return [Time(**{field.name: field.type(row[field.name]) for field in fields(Time)}) for row in rows]
