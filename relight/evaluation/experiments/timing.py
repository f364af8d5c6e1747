"""Measures the inference time of networks (the paper, section 1: 0.43 s at 1024 px)."""

import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import torch

from relight.config import Model, Timing
from relight.evaluation.scoring.scores import read_table
from relight.files import atomic_write
from relight.learning.networks import build
from relight.processes import count_cores
from relight.progress import progress

SECONDS = 1.0  # for which the calls of a measurement are repeated
MIN_CALLS = 3  # of a measurement
COLUMNS = ["row", "width", "parameters", "size", "device", "threads", "wall", "cpu"]


def fastest_call(call: Callable[[], object], device: str, seconds: float = SECONDS) -> tuple[float, float]:
    """Returns the least wall and CPU seconds of repeated calls, since other work of the machine only adds time.

    Args:
        call: is made once to warm up, then at least MIN_CALLS times.
        device: on cuda, a call lasts until the GPU has finished.
        seconds: for which calls are repeated.

    Returns:
        The least wall time, and the least CPU time over all threads, seconds; they can be those of different calls.
    """
    walls: list[float] = []
    cpus: list[float] = []
    call()
    deadline = time.perf_counter() + seconds
    while len(walls) < MIN_CALLS or time.perf_counter() < deadline:
        start, cpu_start = time.perf_counter(), time.process_time()
        call()
        if device == "cuda":
            torch.cuda.synchronize()
        walls.append(time.perf_counter() - start)
        cpus.append(time.process_time() - cpu_start)
    return min(walls), min(cpus)


def time_networks(models: dict[str, Model], settings: Timing, out: Path) -> None:
    """Times networks on single pictures in float32: on one thread, on all threads, and on a GPU if there is one.

    Weights are untrained: they do not affect the time.

    Args:
        models: row -> settings of its network.
        settings: sizes of the pictures.
        out: the table (.csv) of COLUMNS. wall, cpu: seconds per picture; cpu is the sum over threads, 0 on a GPU.
    """
    before, cores = torch.get_num_threads(), count_cores()
    devices = [("cpu", 1)] + [("cpu", cores)] * (cores > 1) + [("cuda", 1)] * torch.cuda.is_available()
    rows: list[dict] = []
    try:
        for device, threads in devices:
            torch.set_num_threads(threads)
            cases = [(row, size) for row in models for size in settings.sizes]
            for row, size in progress(cases, f"networks timed on {device}, threads {threads}"):
                measured = time_network(models[row], size, device)
                rows.append({"row": row, "device": device, "threads": threads, **measured})
    finally:
        torch.set_num_threads(before)
    with atomic_write(out) as tmp:
        pd.DataFrame(rows)[COLUMNS].to_csv(tmp, index=False, float_format="%.6g", lineterminator="\n")


@torch.inference_mode()
def time_network(model: Model, size: int, device: str) -> dict[str, float]:
    """Times one network at one size, on a single picture.

    Args:
        model: settings of the network.
        size: side of the picture, pixels.
        device: cpu or cuda.

    Returns:
        width (over the paper's), parameters (their number), size, wall and cpu (seconds; 0 on a GPU).
    """
    network = build(model, size).to(device).eval()
    image = torch.rand((1, 3, size, size), device=device).contiguous(memory_format=torch.channels_last)
    mask = torch.ones((1, 1, size, size), device=device)
    wall, cpu = fastest_call(lambda: network(image, mask), device)
    return {
        "width": model.width,
        "parameters": sum(p.numel() for p in network.parameters()),
        "size": size,
        "wall": wall,
        "cpu": 0.0 if device == "cuda" else cpu,
    }


def read_times(path: Path) -> pd.DataFrame:
    """Reads a table of `time_networks`. Raises UserError if it is another table."""
    return read_table(path, "times", COLUMNS, "the stage inference_time")
