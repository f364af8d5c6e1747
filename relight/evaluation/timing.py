"""How long a network takes for a picture (paper, section 1: .43 s at 1024 px), and what the machine could do."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pandas as pd
import torch
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils.flop_counter import FlopCounterMode

from relight.config import Model, Timing
from relight.evaluation.scores import read_table
from relight.files import atomic_write
from relight.learning.networks import build
from relight.processes import count_cores
from relight.progress import progress

TYPES = {"f32": torch.float32, "bf16": torch.bfloat16}
COLUMNS = ["row", "width", "parameters", "size", "device", "threads", "wall", "cpu", "gflop", "rate"]


def matmul_rate(clock: Callable[[Callable[[], object]], float], device: str, precision: str) -> float:
    """Measures a large square matrix product.

    Args:
        clock: call -> seconds.
        device: cpu or cuda.
        precision: of TYPES.

    Returns:
        Operations per second.
    """
    side = 8192 if device == "cuda" else 2048
    a = torch.randn(side, side, device=device, dtype=TYPES[precision])
    return 2 * side**3 / clock(lambda: a @ a)


def multiply_adds(model: Model, size: int) -> float:
    """Counts the multiply-adds of an inference.

    Tensors are fakes: they have a device, as autocast needs, and no numbers.

    Args:
        model: settings of the network.
        size: side of the image in pixels.
    """
    network = build(model, size)
    with FakeTensorMode(allow_non_fake_inputs=True), FlopCounterMode(display=False) as counter:
        network(torch.empty(1, 3, size, size), torch.empty(1, 1, size, size))
    return counter.get_total_flops() / 2


def wall(call: Callable[[], object], device: str, seconds: float) -> float:
    """Least wall seconds of a call."""
    return least(call, device, seconds)[0]


def least(call: Callable[[], object], device: str, seconds: float) -> tuple[float, float]:
    """Least wall and CPU seconds of a call in about `seconds`, three calls at least after one that does not count.

    It is the least because other work of the machine adds to the rest. On a GPU a call has ended when its work has.
    """
    walls: list[float] = []
    processors: list[float] = []
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
    """Times networks, one picture at a time in float32, on one thread, on all, and on a GPU where there is one.

    Weights are untrained: they take no part in how long a network needs.

    Args:
        models: row -> settings of its network.
        settings: at which sizes, and for how many seconds each.
        out: the table (.csv) of COLUMNS. wall, cpu: seconds for a picture; cpu counts all threads, 0 on a GPU. gflop:
            two operations per multiply-add. rate: GFLOP/s of a large matrix product on the same threads or GPU.
    """
    before, cores = torch.get_num_threads(), count_cores()
    places = [("cpu", 1)] + [("cpu", cores)] * (cores > 1) + [("cuda", 1)] * torch.cuda.is_available()
    found: list[dict] = []
    try:
        for device, threads in places:
            torch.set_num_threads(threads)
            rate = matmul_rate(partial(wall, device=device, seconds=settings.seconds), device, "f32") / 1e9
            cases = [(row, size) for row in models for size in settings.sizes]
            for row, size in progress(cases, f"networks timed on {device}, threads {threads}"):
                made = timed(models[row], size, device, settings.seconds)
                found.append({"row": row, "device": device, "threads": threads, "rate": rate, **made})
    finally:
        torch.set_num_threads(before)
    with atomic_write(out) as tmp:
        pd.DataFrame(found)[COLUMNS].to_csv(tmp, index=False, float_format="%.6g", lineterminator="\n")


@torch.inference_mode()
def timed(model: Model, size: int, device: str, seconds: float) -> dict[str, float]:
    """What is measured of one network at one size."""
    network = build(model, size).to(device).eval()
    image = torch.rand(1, 3, size, size, device=device).contiguous(memory_format=torch.channels_last)
    mask = torch.ones(1, 1, size, size, device=device)
    taken, busy = least(lambda: network(image, mask), device, seconds)
    return {
        "width": model.width,
        "parameters": sum(p.numel() for p in network.parameters()),
        "size": size,
        "wall": taken,
        "cpu": 0.0 if device == "cuda" else busy,
        "gflop": 2 * multiply_adds(model, size) / 1e9,
    }


def read_times(path: Path) -> pd.DataFrame:
    """What `time_networks` wrote, and `share`: of the matrix rate that a network reaches, in wall time.

    Raises:
        UserError: it is another table.
    """
    table = read_table(path, "times", COLUMNS, "relight-inference-time")
    return table.assign(share=table.gflop / table.wall / table.rate)
