"""Measures figures per CPU-hour, and the time of each part of a figure, over consecutive seeds in one process.

python benchmarks/figures.py --seeds 0-11 --detail full --texture 1024
"""

import argparse
import json
import resource
import time

import numpy as np

from relight.figures import dress
from relight.figures.commands import seeds_of

PARTS = {  # label: a function's module or class, and its name
    "build_body": (dress, "build_body"),
    "motion": (dress, "build_motion"),
    "wear": (dress, "drape_outfit"),
    "assemble": (dress.Assembly, "add_all"),
    "gates": (dress.gates, "check_figure"),
}


def main() -> None:
    """Prints the CPU-seconds of each figure and the share of each part of the generator."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0-11")
    parser.add_argument("--detail", default="full", choices=dress.DETAILS)
    parser.add_argument("--texture", type=int, default=1024)
    options = parser.parse_args()
    spent: dict[str, float] = dict.fromkeys(PARTS, 0.0)

    def timed(module, name: str, part: str) -> None:
        inner = getattr(module, name)

        def outer(*args):
            start = time.process_time()
            result = inner(*args)
            spent[part] += time.process_time() - start
            return result

        setattr(module, name, outer)

    for part, (owner, function) in PARTS.items():
        timed(owner, function, part)
    dress.colliders.init_warp()
    start = time.process_time()
    dress.make_figure(0, "draft", 64)  # warm-up: compiles or loads the kernels, and reads the data
    print(json.dumps({"warm-up, CPU s": round(time.process_time() - start, 1)}))
    spent.update(dict.fromkeys(spent, 0.0))
    seconds, redrawn = [], 0
    for seed in seeds_of(options.seeds):
        start = time.process_time()
        mesh = dress.make_figure(seed, options.detail, options.texture)
        seconds.append(time.process_time() - start)
        redrawn += mesh.info["redrawn"]
        print(json.dumps({"seed": seed, "CPU s": round(seconds[-1], 1), "vertices": len(mesh.vertices)}), flush=True)
    report = {
        "detail": options.detail,
        "figures": len(seconds),
        "CPU s a figure": {"mean": round(np.mean(seconds), 2), "max": round(max(seconds), 2)},
        "figures per CPU-hour": round(3600 / np.mean(seconds)),
        "draws a figure": round(1 + redrawn / len(seconds), 2),
        "share": {part: round(value / sum(seconds), 3) for part, value in spent.items()},
        "peak memory, GB": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, 2),
    }
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
