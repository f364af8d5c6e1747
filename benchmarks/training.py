"""Speed and memory of training and inference, against what the device's matrix products reach.

    python benchmarks/training.py                       # the CPU, one thread, CPU time: holds on a busy machine too
    python benchmarks/training.py --device cuda         # the first GPU, wall time
    python benchmarks/training.py --cases 256:1:8:f32   # size:width:batch:precision, any number of them

A step is: relight the batch from the packed set ("data"), the network forward and backward, the 15 losses forward and
backward ("losses"), Adam. GFLOP/s counts two operations per multiply-add of the convolutions and three passes: forward,
and backward for inputs and for weights. "share" is that over the rate of a large square matrix product, measured on the
same machine in the same precision.
"""

import argparse
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from relight.config import Loss, Model
from relight.learning.data import Batch, RelitSet
from relight.learning.losses import losses, weights
from relight.learning.networks import build
from relight.maps.exr import write_maps
from relight.maps.maps import Maps
from relight.maps.packed import pack
from relight.sh.irradiance import unoccluded

CASES = {
    "cpu": ["128:0.25:4:f32", "128:0.25:4:bf16", "256:1:8:f32", "1024:1:1:f32"],
    "cuda": ["128:1:64:bf16", "256:1:16:f32", "256:1:16:bf16", "512:1:8:bf16", "1024:1:1:bf16", "1024:1:4:bf16"],
}
FULL = Loss(
    **dict.fromkeys(
        "albedo transport light tv_albedo tv_transport shading reconstruction reconstruction_full".split(), 1.0
    ),
    tv_reference=1024,
    reduction="image",
)
TYPES = {"f32": torch.float32, "bf16": torch.bfloat16}


def figure(size: int, name: str) -> Maps:
    """An ellipse with bulges that covers 16 % of the image, as a person does."""
    row, column = np.mgrid[:size, :size]
    x, y = (2 * column + 1) / size - 1, 1 - (2 * row + 1) / size
    mask = (x / 0.23) ** 2 + (y / 0.9) ** 2 < 1
    slope = np.stack([np.sin(20 * x), np.sin(20 * y), np.full_like(x, 1.5)], -1)
    normal = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    maps = {"albedo": np.full((size, size, 3), 0.4), "normal": normal, "transport": unoccluded(normal, 2)}
    maps = {key: (value * mask[..., None]).astype(np.float32) for key, value in maps.items()}
    flat = mask.astype(np.float32)
    return Maps(mask, flat, depth=flat, ao=flat, info={"name": name, "subject": name, "size": size, "order": 2}, **maps)


def data_set(size: int, folder: Path, device: str) -> RelitSet:
    """Four figures and 40 lights."""
    paths = [folder / f"{i}.exr" for i in range(4)]
    for path in paths:
        write_maps(path, figure(size, path.stem))
    pack(paths, folder / "packed.safetensors")
    lights = np.random.default_rng(0).normal(0.3, 0.1, (40, 9, 3)).astype(np.float32)
    np.savez(folder / "lights.npz", coefficients=lights, split=np.full(40, "train"), source=np.full(40, "room"))
    return RelitSet(folder / "packed.safetensors", folder / "lights.npz", 2, "paper", device)


class Clock:
    """Seconds of a call: the least of CPU time on one thread, the median of wall time otherwise."""

    def __init__(self, device: str, threads: int, seconds: float):
        self.cuda, self.cpu_time, self.seconds = device == "cuda", device == "cpu" and threads == 1, seconds

    def now(self) -> float:
        if self.cuda:
            torch.cuda.synchronize()
        return time.process_time() if self.cpu_time else time.perf_counter()

    def __call__(self, call: Callable[[], object]) -> float:
        call()
        taken, until = [], time.perf_counter() + self.seconds
        while len(taken) < 3 or time.perf_counter() < until:
            start = self.now()
            call()
            taken.append(self.now() - start)
        return min(taken) if self.cpu_time else statistics.median(taken)


def matmul_rate(clock: Clock, device: str, precision: str) -> float:
    """Operations per second of a large square matrix product."""
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


def measure(case: str, device: str, clock: Clock, compiled: bool) -> None:
    size, width, count, precision = case.split(":")
    size, count = int(size), int(count)
    model = Model(
        "ours", float(width), "instance" if count == 1 else "batch", 0.5, 2, "clip", "strided", False, "image"
    )
    with tempfile.TemporaryDirectory() as folder:
        data = data_set(size, Path(folder), device)
    network = build(model, size).to(device).train()
    forward = torch.compile(network) if compiled else network
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-4, fused=True)
    autocast = torch.autocast(device, torch.bfloat16) if precision == "bf16" else nullcontext()
    weight, rng = weights(FULL, size), np.random.default_rng(1)

    def draw() -> Batch:
        return data.batch(rng.integers(0, 4, count), rng.integers(0, 40, count))

    def total(outputs: dict, batch: Batch) -> torch.Tensor:
        return sum(weight[name] * value for name, value in losses(outputs, batch, FULL).items())

    def step(batch: Batch) -> None:
        with autocast:
            outputs = forward(batch.image, batch.mask)
        loss = total(outputs, batch)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()

    fixed = draw()
    with autocast, torch.no_grad():
        leaves = {name: value.detach().requires_grad_() for name, value in network(fixed.image, fixed.mask).items()}

    def infer() -> None:
        with autocast, torch.inference_mode():
            network(fixed.image[:1], fixed.mask[:1])

    if device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    whole, relit = clock(lambda: step(draw())), clock(draw)
    memory = (
        torch.cuda.max_memory_allocated()
        if device == "cuda"
        else 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    )
    lost = clock(lambda: total(leaves, fixed).backward())
    network.eval()
    one, macs, rate = clock(infer), multiply_adds(model, size), matmul_rate(clock, device, precision)
    cells = [
        case,
        f"{1e3 * whole:.1f}",
        f"{count / whole:.2f}",
        f"{6 * macs * count / whole / 1e9:.0f}",
        f"{6 * macs * count / whole / rate:.0%}",
        f"{relit / whole:.1%}",
        f"{lost / whole:.1%}",
        f"{1e3 * one:.1f}",
        f"{2 * macs / one / rate:.0%}",
        f"{memory / 2**30:.1f}",
    ]
    print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--threads", type=int, default=1, help="of the CPU; with more than one, wall time is measured")
    parser.add_argument("--cases", nargs="+", metavar="SIZE:WIDTH:BATCH:PRECISION", help="f32 or bf16")
    parser.add_argument("--seconds", type=float, default=5.0, help="spent on each measurement at least")
    parser.add_argument("--compile", action="store_true", help="torch.compile the network")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.backends.cudnn.benchmark = True
    clock = Clock(options.device, options.threads, options.seconds)
    for precision in TYPES:
        print(f"matrix products, {precision}: {matmul_rate(clock, options.device, precision) / 1e9:.0f} GFLOP/s")
    print("| case | ms/step | images/s | GFLOP/s | share | data | losses | inference ms | its share | peak GiB |")
    print("|---" * 10 + "|")
    for case in options.cases or CASES[options.device]:
        measure(case, options.device, clock, options.compile)


if __name__ == "__main__":
    main()
