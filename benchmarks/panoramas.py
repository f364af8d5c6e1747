"""Measures the time for panoramas: reading and projecting 4k x 2k and 1k files, and generating rooms and skies.

    python benchmarks/panoramas.py [--folder 64]

Prints CPU-seconds and peak memory. The targets: 4k x 2k in 1.5 s, 2,144 panoramas of 1k in 15 minutes on two cores with
constant memory, and 2,000 rooms in 60 s on two cores.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenEXR

from relight.panoramas import Panorama, generate_room, generate_sky, project, read_panorama


def hdr_bytes(height: int, width: int, runs: bool) -> bytes:
    """Returns a Radiance picture of noise in the new run-length coding.

    Args:
        height: pixels.
        width: pixels, a multiple of 128.
        runs: whether runs of 4 bytes alternate with literals of 4 (slower to read); else literals of 128 bytes.
    """
    rng = np.random.default_rng(0)
    noise = rng.integers(100, 140, (height, 4, width), np.uint8)
    if runs:
        blocks = noise.reshape(height, 4, width // 8, 8)
        code = np.full((*blocks.shape[:3], 1), 4, np.uint8)
        body = np.concatenate([code + 128, blocks[..., :1], code, blocks[..., 4:]], -1)
    else:
        blocks = noise.reshape(height, 4, width // 128, 128)
        body = np.concatenate([np.full((*blocks.shape[:3], 1), 128, np.uint8), blocks], -1)
    mark = np.broadcast_to(np.array([2, 2, width >> 8, width & 255], np.uint8), (height, 4))
    lines = np.concatenate([mark, body.reshape(height, -1)], -1)
    return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + lines.tobytes()


def write_exr(path: Path, height: int, width: int) -> None:
    """Writes an OpenEXR file of noise, (height,width,3) half floats, compressed by ZIP."""
    pixels = np.random.default_rng(0).random((height, width, 3)).astype(np.float16)
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"RGB": pixels}).write(
        str(path)
    )


def report(what: str, start: float, count: int = 1) -> float:
    """Prints and returns the CPU-seconds since `start` for each of `count` runs, with the peak memory so far."""
    seconds = (time.process_time() - start) / count
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{what:44s} {seconds:8.3f} s CPU each   {memory:6.0f} MB at most")
    return seconds


def main() -> None:
    """Prints the CPU-seconds for reading and generating panoramas."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--folder", type=int, default=64, help="number of 1k panoramas to read")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "small.hdr").write_bytes(hdr_bytes(512, 1024, runs=False))
        start = time.process_time()
        for _ in range(arguments.folder):
            project(read_panorama(folder / "small.hdr"))
        each = report("1024 x 512 .hdr", start, arguments.folder)
        print(f"{'':44s} 2,144 of them on two cores: {2144 * each / 120:.1f} minutes")
        for kind, runs in (("literals", False), ("short runs", True)):
            (folder / "large.hdr").write_bytes(hdr_bytes(2048, 4096, runs))
            start = time.process_time()
            project(read_panorama(folder / "large.hdr"))
            report(f"4096 x 2048 .hdr, {kind}", start)
        write_exr(folder / "large.exr", 2048, 4096)
        start = time.process_time()
        project(read_panorama(folder / "large.exr"))
        report("4096 x 2048 .exr, half, ZIP", start)
    for what, generate in (("room", generate_room), ("sky", generate_sky)):
        start = time.process_time()
        for seed in range(50):
            project(Panorama(generate(seed)))
        report(f"{what} of 128 x 64", start, 50)


if __name__ == "__main__":
    main()
