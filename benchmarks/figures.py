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
    """Prints a line for each figure, and the summary, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0-11")
    parser.add_argument("--detail", default="full", choices=dress.DETAILS)
    parser.add_argument("--texture", type=int, default=1024)
    options = parser.parse_args()
    spent = dict.fromkeys(PARTS, 0.0)  # CPU seconds of each part

    def add_timer(part: str, owner: object, name: str) -> None:
        """Replaces the function `name` of a module or class by one that also adds its CPU time to `spent[part]`."""
        function = getattr(owner, name)

        def timed(*args):
            start = time.process_time()
            result = function(*args)
            spent[part] += time.process_time() - start
            return result

        setattr(owner, name, timed)

    for part, (owner, name) in PARTS.items():
        add_timer(part, owner, name)
    dress.colliders.init_warp()
    start = time.process_time()
    dress.make_figure(seed=0, detail="draft", texture=64)  # warm-up: compiles or loads kernels, and reads the data
    print(json.dumps({"warm-up, CPU s": round(time.process_time() - start, 1)}))
    spent.update(dict.fromkeys(PARTS, 0.0))
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
