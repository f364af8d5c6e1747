"""Measures errors and invariances of networks for photographs: to framing, mask, exposure, white balance, mirroring.

    python benchmarks/invariance.py relight/weights/photo.onnx [other.onnx ...]

Prints a table with a column for each network: the measures of `relight.benchmark.measures`, without a path tracer. The
figures (seeds 9000 to 9005, and one person in 12 poses: 9600 to 9611) and the six rooms are in no training set of
`experiment=photo`; they are generated and baked at 512 px once, and stored in --cache. Inference is by the code of
`relight photo`. A network that always infers the same light is invariant, too: read these rows with the errors.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from functools import partial
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion

from relight.benchmark.measures import INVARIANCES, LEAKS, Intrinsics, errors, invariances, leaks
from relight.benchmark.picture import on_square
from relight.benchmark.shots import variants
from relight.core.progress import progress
from relight.core.srgb import encode, to_bytes
from relight.evaluation.scoring import metrics
from relight.figures.make import GENERATOR
from relight.lights import Light
from relight.lights.chain import generated_light
from relight.maps import Maps, read_maps, write_maps
from relight.maps.square import Crop, crop_around
from relight.photos.api import Relighter, load
from relight.photos.person import infer_person
from relight.sh import basis

SEEDS = range(9000, 9006)
POSES = range(9600, 9612)  # one person in one outfit
ROOMS = range(50000, 50006)
SIZE = 512
BACKGROUND = 0.18  # linear value of the plain background
ERRORS = {
    "albedo": "error of albedo",
    "transport": "error of transport",
    "shading": "error of shading",
    "light": "error of light",
    "light_factor": "error of light, up to a factor",
    "albedo_factor": "error of albedo, up to a factor",
    "shading_factor": "error of shading, up to a factor",
}
RIM = {
    "rim": "lamp 130° from the front: outermost pixels, over the true",
    "inside": "the same lamp: inside, over the true",
}
LAMP = 130  # degrees from the direction of the camera
SPREAD = {
    "poses": "light: one person in 12 poses, spread",
    "poses_relative": "the same, over the spread between the six rooms",
}


def figures(cache: Path, seeds: range, per_subject: int = 1) -> list[Maps]:
    """Returns the maps of generated figures, which are made unless they are in the cache.

    Args:
        cache: folder of maps.
        seeds: of the figures.
        per_subject: number of consecutive seeds that are one person in one outfit, in different poses.
    """
    from transport import figure

    from relight.transport import bake

    cache.mkdir(parents=True, exist_ok=True)
    paths = {seed: cache / f"v{GENERATOR}_{SIZE}px_{seed}.exr" for seed in seeds}
    for seed, path in progress(paths.items(), "figures", len(paths)):
        if not path.exists():
            mesh = figure(path=None, seed=seed, per_subject=per_subject)
            write_maps(path, bake(mesh, SIZE, rays=256, supersample=2))
    return [read_maps(path) for path in paths.values()]


def take_photograph(maps: Maps, light: np.ndarray, gain: np.ndarray | float = 1.0) -> np.ndarray:
    """Returns the photograph (H,W,3) uint8 of a figure before a plain background.

    Args:
        maps: of the figure.
        light: (9,3) radiance coefficients.
        gain: on the linear values before they are clipped, a number or (3,).
    """
    linear = maps.albedo * np.maximum(maps.transport @ light, 0)
    coverage = maps.coverage[..., None]
    return to_bytes(encode(np.clip((linear * coverage + BACKGROUND * (1 - coverage)) * gain, 0, 1)))


def truth(maps: Maps, light: np.ndarray, box: Crop) -> Intrinsics:
    """Returns the true maps and light of a figure on a square of the picture; `light` is (9,3)."""
    return on_square(maps, np.maximum(maps.transport @ light, 0), light, box)


def score(relighter: Relighter, maps: Maps, light: np.ndarray) -> dict[str, float]:
    """Returns all rows of the table for one figure under one light (9,3), by name."""
    shots = variants(partial(take_photograph, maps, light), to_bytes(maps.coverage), relighter.network.size)
    people = {name: infer_person(relighter.network, shot.photo, shot.mask, shot.square) for name, shot in shots.items()}
    inferred = {  # with bands 0 to 2 of networks of a higher order
        name: Intrinsics(person.mask, person.albedo, person.transport[..., :9], person.shading, person.light[:9])
        for name, person in people.items()
    }
    true = truth(maps, light, shots[""].square)
    return {
        **errors(inferred[""], true),
        **invariances(inferred),
        **leaks(inferred[""]),
        **lit_from_behind(inferred[""].transport, true),
    }


def lit_from_behind(transport: np.ndarray, true: Intrinsics) -> dict[str, float]:
    """Returns the light that a lamp behind the figure gives by the inferred transport (S,S,9), over the true light.

    Means over lamps LAMP degrees to the left and to the right of the camera.

    Returns:
        `rim`: of the outermost pixels of the figure; `inside`: of pixels four or more from the outline.
    """
    angle = np.radians(LAMP)
    lamps = basis(np.array([[side * np.sin(angle), 0, np.cos(angle)] for side in (-1, 1)]))
    regions = {"rim": true.mask & ~binary_erosion(true.mask), "inside": binary_erosion(true.mask, iterations=4)}
    shadings = [np.maximum(maps @ lamps.T, 0) for maps in (transport, true.transport)]
    return {
        name: float(np.divide(*(shading[region].mean() for shading in shadings))) for name, region in regions.items()
    }


def pose_spread(relighter: Relighter, poses: list[Maps], lights: list[np.ndarray], name: str) -> dict[str, float]:
    """Measures how much the inferred light of one person changes with the pose, as coefficients of irradiance.

    Args:
        relighter: the network.
        poses: maps of the person in each pose.
        lights: (9,3) each, under which all poses are seen.
        name: of the network, for the progress.

    Returns:
        `poses`: the standard deviation over poses (as the norm of a vector), over the norm of their mean; mean over the
        lights. `poses_relative`: the root mean square over the lights of the standard deviation over poses, over
        the standard deviation over lights of the mean over poses.
    """
    means, variances = [], []
    for light in progress(lights, f"{name}, poses"):
        shots = ((take_photograph(maps, light), to_bytes(maps.coverage)) for maps in poses)
        irradiance = np.stack([metrics.irradiance(infer_person(relighter.network, *shot).light[:9]) for shot in shots])
        means.append(irradiance.mean(0))
        variances.append(((irradiance - means[-1]) ** 2).sum((1, 2)).mean())
    spreads = np.sqrt(variances) / [np.linalg.norm(mean) for mean in means]
    between = ((means - np.mean(means, 0)) ** 2).sum((1, 2)).mean()
    return {"poses": float(spreads.mean()), "poses_relative": float(np.sqrt(np.mean(variances) / between))}


def main() -> None:
    """Prints the table, with a column for each network and one for the truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path, nargs="+")
    parser.add_argument("--cache", type=Path, default=Path("results/invariance"), help="of the figures' maps")
    args = parser.parse_args()
    people, poses = figures(args.cache, SEEDS), figures(args.cache, POSES, len(POSES))
    lights = []
    for room in ROOMS:
        source = f"room:{room}"
        lights.append(Light(generated_light(source, order=2), source).normalised().coefficients)
    columns = {}
    for path in args.weights:
        relighter = load(path, threads=1)
        rows = [score(relighter, maps, light) for maps, light in progress(list(zip(people, lights)), path.stem)]
        columns[str(path)] = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
        columns[str(path)] |= pose_spread(relighter, poses, lights, path.stem)
    squares = [crop_around(to_bytes(maps.coverage), relighter.network.size) for maps in people]
    rows = [leaks(truth(maps, light, square)) for maps, light, square in zip(people, lights, squares)]
    ideal = {"dark_albedo": 1.0, "dark_shading": 0.5, "tint": 1.0, "rim": 1.0, "inside": 1.0}
    columns["truth"] = {**ideal, **{name: float(np.mean([row[name] for row in rows])) for name in LEAKS}}
    print("| | " + " | ".join(columns) + " |\n|---|" + "---|" * len(columns))
    for name, words in {**ERRORS, **INVARIANCES, **SPREAD, **LEAKS, **RIM}.items():
        cells = (f"{column[name]:.3f}" if name in column else "" for column in columns.values())
        print(f"| {words} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
