"""What supersampling buys: how far a baked map is from the mean over each pixel, at equal rays, and what it costs.

    python benchmarks/supersampling.py --size 256 --seeds 0 4 10

The truth is a bake of four times the size with 1024 rays, averaged over its 4 x 4 pixels in each one. Errors are
root mean squares over pixels (whole inside the figure) of the 9-vector's length; "smooth" are the pixels whose truth
stays within .05 over the 4 x 4, where only the sampling of directions is left. CPU time, one thread, one process.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is there, see transport.py

import argparse
import time

import numpy as np
from transport import figure

from relight.transport import bake


def blocks(values: np.ndarray, k: int) -> np.ndarray:
    n = len(values) // k
    return values.reshape(n, k, n, k, *values.shape[2:]).swapaxes(1, 2).reshape(n, n, k * k, *values.shape[2:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 4, 10], help="of the generated figures")
    parser.add_argument("--rays", type=int, default=256)
    args = parser.parse_args()
    cases = [(1, args.rays), (2, args.rays), (4, args.rays), (1, 4 * args.rays)]
    errors, seconds = {case: [] for case in cases}, dict.fromkeys(cases, 0.0)
    for seed in args.seeds:
        mesh = figure(None, seed)
        fine = bake(mesh, 4 * args.size, 1024)
        inside = blocks(fine.mask, 4).all(2)
        all_of = blocks(fine.transport, 4)[inside]
        truth = all_of.mean(1)
        smooth = np.sqrt(((all_of - truth[:, None]) ** 2).sum(-1)).max(1) < 0.05
        for k, rays in cases:
            start = time.process_time()
            maps = bake(mesh, args.size, rays, supersample=k)
            seconds[k, rays] += time.process_time() - start
            squares = ((maps.transport[inside] - truth) ** 2).sum(-1)
            errors[k, rays].append([squares.mean(), squares[smooth].mean(), (maps.ao[inside] < 0.02).sum()])
    print(f"{args.size} px, figures {args.seeds}")
    print("| supersample | rays | RMSE | smooth pixels | black pixels a figure | CPU-s a figure |")
    print("|---|---|---|---|---|---|")
    for k, rays in cases:
        whole, smooth, black = np.mean(errors[k, rays], 0)
        cost = seconds[k, rays] / len(args.seeds)
        print(f"| {k} | {rays} | {whole**0.5:.4f} | {smooth**0.5:.4f} | {black:.0f} | {cost:.2f} |")


if __name__ == "__main__":
    main()
