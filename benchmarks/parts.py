"""Tells what wrong parts of transport and light add to the error of `ratio`: parts are made true in turn.

    relight benchmark make --out build/drafts --count 24 --size 256 --samples 48 --detail draft
    python benchmarks/parts.py build/drafts relight/weights/photo.onnx [other.onnx ...]

Each row has the RMSE and the RMSE* of `ratio` over the pictures of a set, and half the 95 % intervals over its figures:
as they are, and less those of the first network as it infers.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import sem, t

from relight.benchmark.files import BenchmarkSet, Entry
from relight.benchmark.methods import Scene
from relight.benchmark.score import relit_errors
from relight.core.progress import progress
from relight.maps.square import figure_means
from relight.panoramas import project, read_panorama
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.person import OPAQUE, infer_person
from relight.photos.render import frames

ORDER = 4
LOW, ALL = slice(0, 9), slice(0, 25)  # coefficients of bands 0 to 2, and of all
# Name of a row -> the coefficients that are true: of transport, of the photo's light.
PARTS = {
    "as inferred": (slice(0), slice(0)),
    "true light, bands 0 to 2": (slice(0), LOW),
    "true light": (slice(0), ALL),
    "true transport, bands 0 to 2": (LOW, slice(0)),
    "true transport": (ALL, slice(0)),
    "true bands 0 to 2 of both": (LOW, LOW),
    "true bands 3 and 4 of both": (slice(9, 25), slice(9, 25)),
    "both true": (ALL, ALL),
}


def errors(benchmark: BenchmarkSet, entry: Entry, networks: dict[str, PhotoNetwork]) -> Iterator[dict[str, object]]:
    """Yields the errors of a picture's `ratio` by each network with each of PARTS, means over the new lights."""
    shot, (_, pictures), scene = entry.shot(), benchmark.truth(entry), Scene(benchmark, entry, ORDER)
    old, *new = (project(read_panorama(path), ORDER) for path in (benchmark.light(entry), *entry.panoramas()))
    for name, network in networks.items():
        square = replace(shot.square, size=network.size)
        person = infer_person(network, shot.photo, shot.mask, square)
        true = figure_means(scene.maps.coverage, scene.maps.mask, square)[1](scene.maps.transport)
        is_known = person.mask & true.any(-1)
        for part, (of_transport, of_light) in PARTS.items():
            transport, light = np.zeros_like(true), np.zeros_like(old, np.float32)
            transport[..., : person.transport.shape[-1]], light[: len(person.light)] = person.transport, person.light
            transport[is_known, of_transport] = true[is_known, of_transport]
            light[of_light] = old[of_light]
            lit = replace(person, transport=transport, light=light)
            relit = frames(shot.photo, [lit], [(one.astype(np.float32), 0.0) for one in new])
            found = [relit_errors(*pair, shot.mask >= OPAQUE) for pair in zip(relit, pictures)]
            means = {key: np.mean([error[key] for error in found]) for key in ("", "_factor")}
            yield {"figure": entry.figure, "network": name, "part": part, **means}


def estimate(errors: pd.Series) -> str:
    """Returns the mean over figures and half its 95 % interval."""
    figures = errors.groupby("figure").mean()
    return f"{errors.mean():.4f} ± {t.ppf(0.975, len(figures) - 1) * sem(figures):.4f}"


def main() -> None:
    """Prints a row for each network and part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("weights", type=Path, nargs="+")
    args = parser.parse_args()
    benchmark = BenchmarkSet(args.set)
    networks = {path.stem: read_network(path, threads=1) for path in args.weights}
    pictures = [entry for entry in benchmark.entries if not entry.of]
    rows = [row for entry in progress(pictures, "pictures") for row in errors(benchmark, entry, networks)]
    table = pd.DataFrame(rows).set_index("figure").groupby(["network", "part"], sort=False)
    first = next(iter(table))[1]
    print("| network | what is true | RMSE | less the first | RMSE* | less the first |\n" + "|---" * 6 + "|")
    for (name, part), found in table:
        cells = [estimate(values) for key in ("", "_factor") for values in (found[key], found[key] - first[key])]
        print(f"| {name} | {part} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
