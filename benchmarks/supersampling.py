"""Measures the effect of supersampling: the error of baked maps against the mean over each pixel, and the time.

    python benchmarks/supersampling.py --size 256 --seeds 0 4 10

The reference is a bake at four times the size with 1024 rays, averaged over 4 x 4 pixels. Errors are RMS lengths of the
vectors of nine over pixels that the figure covers. In "smooth" pixels, the reference varies by less than .05 over the
4 x 4, so only the sampling of directions causes errors. CPU time, one thread, one process.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported, see transport.py

import argparse
import time

import numpy as np
from transport import figure

from relight.transport import bake

REFERENCE = 4  # side of a pixel in pixels of the reference
SMOOTH = 0.05  # largest distance of a subpixel's transport from the pixel's mean, in smooth pixels
BLACK = 0.02  # ambient occlusion below which a pixel is black


def blocks(values: np.ndarray, k: int) -> np.ndarray:
    """Cuts a picture (S,S,...) into blocks of k x k pixels, (S/k,S/k,k*k,...)."""
    n = len(values) // k
    return values.reshape(n, k, n, k, *values.shape[2:]).swapaxes(1, 2).reshape(n, n, k * k, *values.shape[2:])


def main() -> None:
    """Prints the RMSE and the CPU-seconds of each number of samples and rays."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 4, 10], help="of the generated figures")
    parser.add_argument("--rays", type=int, default=256)
    args = parser.parse_args()
    cases = [(1, args.rays), (2, args.rays), (4, args.rays), (1, 4 * args.rays)]
    errors, seconds = {case: [] for case in cases}, dict.fromkeys(cases, 0.0)
    for seed in args.seeds:
        mesh = figure(None, seed)
        reference = bake(mesh, REFERENCE * args.size, rays=1024)
        inside = blocks(reference.mask, REFERENCE).all(2)
        subpixels = blocks(reference.transport, REFERENCE)[inside]
        truth = subpixels.mean(1)
        smooth = np.sqrt(((subpixels - truth[:, None]) ** 2).sum(-1)).max(1) < SMOOTH
        for k, rays in cases:
            start = time.process_time()
            maps = bake(mesh, args.size, rays, supersample=k)
            seconds[k, rays] += time.process_time() - start
            squares = ((maps.transport[inside] - truth) ** 2).sum(-1)
            errors[k, rays].append([squares.mean(), squares[smooth].mean(), (maps.ao[inside] < BLACK).sum()])
    print(f"{args.size} px, figures {args.seeds}")
    print("| supersample | rays | RMSE | smooth pixels | black pixels a figure | CPU-s a figure |")
    print("|---|---|---|---|---|---|")
    for k, rays in cases:
        whole, smooth, black = np.mean(errors[k, rays], 0)
        cost = seconds[k, rays] / len(args.seeds)
        print(f"| {k} | {rays} | {whole**0.5:.4f} | {smooth**0.5:.4f} | {black:.0f} | {cost:.2f} |")


if __name__ == "__main__":
    main()
