"""Measures the effect of noise, gloss and bounces on transport from a light stage, by path tracing each lamp.

    python benchmarks/lightstage.py --size 128 --samples 8

Mitsuba renders a figure under 331 lamps, one at a time, rounded to 8 bits like published captures. Transport measured
from these frames by `relight.benchmark.lightstage` is compared with transport baked from the mesh. The columns are
those of `relight.benchmark.bakedstage.agreement`.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from transport import figure

from relight.benchmark.bakedstage import agreement, bake_as_seen
from relight.benchmark.lightstage import LightStage, Pinhole, measure
from relight.benchmark.recipes import with_gloss
from relight.meshes import Mesh
from relight.progress import progress
from relight.srgb import encode, to_bytes
from relight.transport import PathTracer
from relight.transport.camera import Camera
from relight.transport.tracer import path_integrator

DISTANCE = 4.0  # of the eye, in half heights of the picture
RADIUS = 2.6  # of the stage: 2.5 m where a person has 1.75
LEVEL = 0.6  # k of the frames


def lamps(count: int) -> np.ndarray:
    """Returns positions (L,3) on Vogel's spiral over the sphere."""
    index = np.arange(count) + 0.5
    y, angle = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    around = np.sqrt(1 - y * y)
    return RADIUS * np.stack([around * np.cos(angle), y, around * np.sin(angle)], -1)


def render_frames(tracer: PathTracer, positions: np.ndarray, samples: int, bounces: int) -> Iterator[np.ndarray]:
    """Yields the frame (S,S,3) uint8 of each lamp."""
    scene = tracer.mi.load_dict(
        {
            "type": "scene",
            **tracer.shapes,
            "lamp": {"type": "point", "position": [0.0, 0.0, RADIUS], "intensity": np.pi * LEVEL * RADIUS**2},
            "sensor": {
                **tracer._sensor(),
                "film": {
                    "type": "hdrfilm",
                    "width": tracer.size,
                    "height": tracer.size,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
                "sampler": {"type": "multijitter", "sample_count": samples},
            },
            "integrator": path_integrator(bounces),
        }
    )
    found = tracer.mi.traverse(scene)
    for number, position in enumerate(positions):
        found["lamp.position"] = position.tolist()
        found.update()
        yield to_bytes(encode(np.array(tracer.mi.render(scene, seed=number))))


def compare(name: str, mesh: Mesh, gloss: bool, size: int, samples: int, bounces: int, count: int) -> None:
    """Prints a row."""
    camera = Pinhole(
        (size, size), np.full(2, size / 2 * DISTANCE), np.full(2, size / 2), np.eye(3), np.array([0, 0, DISTANCE])
    )
    tracer = PathTracer(mesh, size, Camera(size, DISTANCE, True), gloss)
    stage = LightStage.from_positions(lamps(count) - camera.eye)
    row, column = np.mgrid[:size, :size] + 0.5
    shown = bake_as_seen(mesh, camera, np.ones((size, size), bool), stage, 1, 1)
    inside = shown.hit.reshape(size, size)
    baked = bake_as_seen(mesh, camera, inside, stage, 1024)
    points = camera.rays(column[inside], row[inside])[:, 3:] * baked.depth[:, None]
    images = progress(render_frames(tracer, stage.positions + camera.eye, samples, bounces), name, count)
    frames = [(lamp, image[inside]) for lamp, image in enumerate(images)]
    found = agreement(measure(lambda: frames, stage, points), baked, inside)
    keys = ("pixels", "length", "difference", "shape", "lamps", "rest", "noise", "factor", "normals")
    print(f"| {name} | {' | '.join(f'{found[key]:.4g}' for key in keys)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--mesh", type=Path, help="a mesh instead of a generated figure")
    parser.add_argument("--seed", type=int, default=900_001, help="of the generated figure")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--samples", type=int, default=8, help="of the path tracer, per pixel")
    parser.add_argument("--lamps", type=int, default=331)
    args = parser.parse_args()
    mesh = with_gloss(figure(args.mesh, args.seed), args.seed)
    print("| frames | pixels | length | difference | shape | lamps | rest | 8 bits | factor | normals, degrees |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, gloss, bounces in (("matt", False, 0), ("one bounce", False, 1), ("one bounce, gloss", True, 1)):
        compare(name, mesh, gloss, args.size, args.samples, bounces, args.lamps)


if __name__ == "__main__":
    main()
