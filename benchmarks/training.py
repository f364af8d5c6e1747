"""Measures speed and memory of training and inference, relative to the device's rate of matrix products.

    python benchmarks/training.py                       # the CPU, one thread, CPU time: also valid on a busy machine
    python benchmarks/training.py --device cuda         # the first GPU, wall time
    python benchmarks/training.py --cases 256:1:8:f32   # size:width:batch:precision, one or more
    python benchmarks/training.py --optimizers          # a step of each optimizer alone, on the network for photos
    python benchmarks/training.py --memory smoke demo study paper

A step is: relight the batch from the packed set ("data"), the network forward and backward, the 15 losses forward and
backward ("losses"), Adam. GFLOP/s counts two operations per multiply-add of the convolutions in three passes: forward,
and backward for inputs and for weights. "share" is this rate over that of a large square matrix product, on the same
machine in the same precision.

--memory: "step" is the memory of weights, gradients, Adam's moments, activations and four figures, without that of a
process that has only imported torch; "packed set" is that of all figures of the preset, with masks of 16 % of the
image.
"""

import argparse
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from omegaconf import OmegaConf
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils.flop_counter import FlopCounterMode

from relight.learning.data import Batch, RelitSet
from relight.learning.losses import losses
from relight.learning.networks import build
from relight.learning.optimizers import make_optimizers
from relight.maps import Maps, pack_maps, write_maps
from relight.settings import Model, composed
from relight.sh import unoccluded

CASES = {
    "cpu": ["128:0.25:4:f32", "128:0.25:4:bf16", "256:1:8:f32", "1024:1:1:f32"],
    "cuda": ["128:1:64:bf16", "256:1:16:f32", "256:1:16:bf16", "512:1:8:bf16", "1024:1:1:bf16", "1024:1:4:bf16"],
}
FULL = OmegaConf.to_object(composed(["loss=full"])).loss
MASK_SHARE = 0.16  # of the image
FIGURES, LIGHTS = 4, 40  # of the data set
LEARNING_RATE = 1e-4  # any, since only time is measured
TYPES = {"f32": torch.float32, "bf16": torch.bfloat16}


def matmul_rate(clock: Callable[[Callable[[], object]], float], device: str, precision: str) -> float:
    """Measures the rate of a large square matrix product.

    Args:
        clock: returns the seconds of a call.
        device: cpu or cuda.
        precision: a key of TYPES.

    Returns:
        Floating-point operations per second.
    """
    side = 8192 if device == "cuda" else 2048
    a = torch.randn(side, side, device=device, dtype=TYPES[precision])
    return 2 * side**3 / clock(lambda: a @ a)


def multiply_adds(model: Model, size: int) -> float:
    """Counts the multiply-adds of an inference, with fake tensors, which have a device but no data.

    Args:
        model: settings of the network.
        size: side of the image in pixels.
    """
    network = build(model, size)
    with FakeTensorMode(allow_non_fake_inputs=True), FlopCounterMode(display=False) as counter:
        network(torch.empty(1, 3, size, size), torch.empty(1, 1, size, size))
    return counter.get_total_flops() / 2


def figure(size: int, name: str) -> Maps:
    """Returns the maps of an ellipse with bulges that covers 16 % of an image, like a person.

    Args:
        size: side of the image, pixels.
        name: of the figure.
    """
    row, column = np.mgrid[:size, :size]
    x, y = (2 * column + 1) / size - 1, 1 - (2 * row + 1) / size
    mask = (x / 0.23) ** 2 + (y / 0.9) ** 2 < 1
    slope = np.stack([np.sin(20 * x), np.sin(20 * y), np.full_like(x, 1.5)], -1)
    normal = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    maps = {"albedo": np.full((size, size, 3), 0.4), "normal": normal, "transport": unoccluded(normal, order=2)}
    maps = {key: (value * mask[..., None]).astype(np.float32) for key, value in maps.items()}
    flat = mask.astype(np.float32)
    return Maps(mask, flat, depth=flat, ao=flat, info={"name": name, "subject": name, "size": size, "order": 2}, **maps)


def data_set(size: int, folder: Path, device: str) -> RelitSet:
    """Writes and loads a data set of FIGURES figures and LIGHTS lights.

    Args:
        size: side of the images, pixels.
        folder: an empty folder.
        device: cpu or cuda.
    """
    paths = [folder / f"{i}.exr" for i in range(FIGURES)]
    for path in paths:
        write_maps(path, figure(size, path.stem))
    pack_maps(paths, folder / "packed.safetensors")
    lights = np.random.default_rng(0).normal(0.3, 0.1, (LIGHTS, 9, 3)).astype(np.float32)
    split, source = np.full(LIGHTS, "train"), np.full(LIGHTS, "room")
    np.savez(folder / "lights.npz", coefficients=lights, split=split, source=source)
    return RelitSet(folder / "packed.safetensors", folder / "lights.npz", order=2, color="paper", device=device)


class Clock:
    """Measures the seconds of a call: the least CPU time on one thread, else the median of wall time."""

    def __init__(self, device: str, threads: int, seconds: float):
        """Takes cpu or cuda, the number of torch's threads, and the seconds for which a call is repeated."""
        self.cuda, self.cpu_time, self.seconds = device == "cuda", device == "cpu" and threads == 1, seconds

    def now(self) -> float:
        """Returns the time in seconds, when the GPU has finished."""
        if self.cuda:
            torch.cuda.synchronize()
        return time.process_time() if self.cpu_time else time.perf_counter()

    def __call__(self, call: Callable[[], object]) -> float:
        """Returns the seconds of a call, which is made once to warm up, then at least three times."""
        call()
        times, deadline = [], time.perf_counter() + self.seconds
        while len(times) < 3 or time.perf_counter() < deadline:
            start = self.now()
            call()
            times.append(self.now() - start)
        return min(times) if self.cpu_time else statistics.median(times)


class Case:
    """A training: network, data, and step."""

    def __init__(self, model: Model, size: int, count: int, precision: str, device: str, compiled: bool, folder: Path):
        """Builds a network and a data set.

        Args:
            model: settings of the network.
            size: side of the images, pixels.
            count: images of a batch.
            precision: a key of TYPES.
            device: cpu or cuda.
            compiled: whether the network is compiled.
            folder: an empty folder for the data set.
        """
        self.data, self.count = data_set(size, folder, device), count
        self.network = build(model, size).to(device).train()
        self.forward = torch.compile(self.network) if compiled else self.network
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=LEARNING_RATE, fused=True)
        self.autocast = torch.autocast(device, torch.bfloat16) if precision == "bf16" else nullcontext()
        self.rng = np.random.default_rng(1)

    def draw(self) -> Batch:
        """Draws a batch of pairs at random, and relights it."""
        figures = self.rng.integers(FIGURES, size=self.count)
        lights = self.rng.integers(LIGHTS, size=self.count)
        return self.data.batch(figures, lights)

    def total(self, outputs: dict, batch: Batch) -> torch.Tensor:
        """Returns the sum of the 15 losses."""
        return losses(outputs, batch, FULL)[0]

    def step(self) -> None:
        """Takes a step of the training: data, forward, losses, backward, Adam."""
        batch = self.draw()
        with self.autocast:
            outputs = self.forward(batch.image, batch.mask)
        loss = self.total(outputs, batch)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.optimizer.step()


def measure(text: str, device: str, clock: Clock, compiled: bool) -> None:
    """Prints a row: the measurements of one training.

    Args:
        text: the training, size:width:batch:precision.
        device: cpu or cuda.
        clock: returns the seconds of a call.
        compiled: whether the network is compiled.
    """
    size, width, count, precision = text.split(":")
    size, count = int(size), int(count)
    model = Model(
        name="ours",
        width=float(width),
        norm="instance" if count == 1 else "batch",
        dropout=0.5,
        order=2,
        albedo="clip",
        light_head="strided",
        refine=False,
        sees="image",
    )
    if device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    with tempfile.TemporaryDirectory() as folder:
        case = Case(model, size, count, precision, device, compiled, Path(folder))
    fixed = case.draw()
    with case.autocast, torch.no_grad():
        outputs = case.network(fixed.image, fixed.mask)
        leaves = {name: value.detach().requires_grad_() for name, value in outputs.items()}  # to time losses alone

    def infer() -> None:
        """Infers the maps of a single picture."""
        with case.autocast, torch.inference_mode():
            case.network(fixed.image[:1], fixed.mask[:1])

    step_time, data_time = clock(case.step), clock(case.draw)
    memory = peak(device)
    loss_time = clock(lambda: case.total(leaves, fixed).backward())
    case.network.eval()
    inference_time = clock(infer)
    inference_operations = 2 * multiply_adds(model, size)
    step_operations = 3 * inference_operations * count  # forward, and backward for inputs and for weights
    rate = matmul_rate(clock, device, precision)
    cells = [
        text,
        f"{1e3 * step_time:.1f}",
        f"{count / step_time:.2f}",
        f"{step_operations / step_time / 1e9:.0f}",
        f"{step_operations / step_time / rate:.0%}",
        f"{data_time / step_time:.1%}",
        f"{loss_time / step_time:.1%}",
        f"{1e3 * inference_time:.1f}",
        f"{inference_operations / inference_time / rate:.0%}",
        f"{memory / 2**30:.1f}",
    ]
    print("| " + " | ".join(cells) + " |", flush=True)


def peak(device: str) -> int:
    """Returns the peak memory in bytes: of this process, or of torch on the GPU."""
    if device == "cuda":
        return torch.cuda.max_memory_allocated()
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def memory(scale: str, device: str) -> str:
    """Returns a row: the memory of two steps of a preset's training. To be called in a new process.

    Args:
        scale: name of the preset.
        device: cpu or cuda.
    """
    before = peak(device)
    cfg = OmegaConf.to_object(composed([f"scale={scale}"]))
    with tempfile.TemporaryDirectory() as folder:
        case = Case(
            cfg.model, cfg.bake.size, cfg.train.batch, cfg.train.precision, device, cfg.train.compile, Path(folder)
        )
    for _ in range(2):
        case.step()
    stored = sum(
        v.nbytes for v in vars(case.data).values() if isinstance(v, torch.Tensor) and len(v) >= len(case.data.pixel)
    )
    pixels = cfg.figures.count * MASK_SHARE * cfg.bake.size**2
    cells = [
        f"`{scale}`",
        f"{cfg.bake.size} px, {cfg.model.width:g}, {cfg.train.batch}, {cfg.train.precision}",
        f"{sum(p.numel() for p in case.network.parameters()) / 1e6:.1f} M",
        f"{(peak(device) - before) / 2**30:.2f}",
        f"{before / 2**30:.2f}",
        f"{stored / len(case.data.pixel) * pixels / 2**30:.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


def optimizer_times(clock: Clock, width: float, device: str) -> dict[str, float]:
    """Measures a step of each optimizer on the network for photos, with random gradients.

    torch's Muon gets the weights of ours, as the matrices that it expects.

    Args:
        clock: returns the seconds of a call.
        width: of the network, over the paper's.
        device: cpu or cuda.

    Returns:
        Seconds of a step by optimizer; those of Muon are without Adam's for the other weights.
    """
    settings = OmegaConf.to_object(composed(["model=unet", f"model.width={width}", "train=photo"]))
    network = build(settings.model, size=128).to(device)
    for weight in network.parameters():
        weight.grad = torch.randn_like(weight)
    ours = make_optimizers(network, settings.train)["muon"]
    ours.param_groups[0]["lr"] = LEARNING_RATE
    matrices = [weight.detach().flatten(start_dim=1).clone() for weight in ours.param_groups[0]["params"]]
    for matrix in matrices:
        matrix.grad = torch.randn_like(matrix)
    return {
        "Adam, all weights": clock(torch.optim.Adam(network.parameters(), lr=LEARNING_RATE, fused=True).step),
        "Muon, float32 (ours)": clock(ours.step),
        "torch.optim.Muon, bfloat16": clock(torch.optim.Muon(matrices, lr=LEARNING_RATE, nesterov=True).step),
    }


def main() -> None:
    """Prints the table that the options ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--threads", type=int, default=1, help="of the CPU; with more than one, wall time is measured")
    parser.add_argument("--cases", nargs="+", metavar="SIZE:WIDTH:BATCH:PRECISION", help="f32 or bf16")
    parser.add_argument("--seconds", type=float, default=5.0, help="least duration of each measurement")
    parser.add_argument("--compile", action="store_true", help="torch.compile the network")
    parser.add_argument("--memory", nargs="+", metavar="SCALE", help="only the peak memory of these presets' training")
    parser.add_argument("--optimizers", action="store_true", help="only a step of each optimizer, of width 1/2")
    options = parser.parse_args()
    if options.memory:
        print("| preset | size, width, batch, precision | parameters | step, GiB | process, GiB | packed set, GiB |")
        print("|---" * 6 + "|")
        for scale in options.memory:
            with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as fresh:
                print(fresh.submit(memory, scale, options.device).result(), flush=True)
        return
    torch.set_num_threads(options.threads)
    torch.backends.cudnn.benchmark = True
    clock = Clock(options.device, options.threads, options.seconds)
    if options.optimizers:
        for name, seconds in optimizer_times(clock, width=0.5, device=options.device).items():
            print(f"{name}: {1e3 * seconds:.1f} ms a step")
        return
    for precision in ("f32", "bf16"):
        print(f"matrix products, {precision}: {matmul_rate(clock, options.device, precision) / 1e9:.0f} GFLOP/s")
    print("| case | ms/step | images/s | GFLOP/s | share | data | losses | inference ms | its share | peak GiB |")
    print("|---" * 10 + "|")
    for case in options.cases or CASES[options.device]:
        measure(case, options.device, clock, options.compile)


if __name__ == "__main__":
    main()
