"""Measures the effect of noise, gloss and bounces on maps from a light stage, on path-traced captures.

    python benchmarks/lightstage.py --size 128 --samples 8

Mitsuba renders a figure under 331 lamps, one at a time, into the layout of docs/scans.md. Maps measured from these
frames are compared with maps baked from the mesh, two pixels and more inside the mask:

    length       RMS length of baked transport, a vector of nine
    difference   RMS length of measured minus baked transport
    shape        the same after the best factor for each pixel, which removes the error of the measured albedo
    factor       by which measured transport is nearest to baked transport
    albedo       RMS of measured over true albedo, minus one, after the best factor for the picture
    normals      median angle between measured and baked normals, degrees
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image
from scipy.ndimage import binary_erosion
from transport import figure

from relight.benchmark.recipes import with_gloss
from relight.captures.capture import read_capture
from relight.captures.maps import measure_maps
from relight.maps import Maps
from relight.meshes import Mesh
from relight.progress import progress
from relight.srgb import encode, to_bytes
from relight.transport import Baker, PathTracer, View
from relight.transport.tracer import path_integrator

VIEW = View(focal=72.0)  # the eye is four half heights of the picture away
RADIUS = 2.6  # of the stage: 2.5 m where a person has 1.75
LEVEL = 0.6  # k of the frames
EDGE = 2  # pixels along the mask's edge that are not compared


def lamps(count: int) -> np.ndarray:
    """Returns positions (L,3) on Vogel's spiral over the sphere."""
    index = np.arange(count) + 0.5
    y, angle = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    around = np.sqrt(1 - y * y)
    return RADIUS * np.stack([around * np.cos(angle), y, around * np.sin(angle)], -1)


def render_frames(tracer: PathTracer, positions: np.ndarray, samples: int, bounces: int) -> Iterator[np.ndarray]:
    """Renders a figure under one lamp at a time.

    Args:
        tracer: of the figure.
        positions: (L,3) of the lamps, in the frame of the maps.
        samples: per pixel.
        bounces: between surfaces.

    Yields:
        The frame (S,S,3) uint8 sRGB of each lamp.
    """
    film = {"type": "hdrfilm", "width": tracer.size, "height": tracer.size, "pixel_format": "rgb"}
    sampler = {"type": "multijitter", "sample_count": samples}
    scene = tracer.mi.load_dict(
        {
            "type": "scene",
            **tracer.shapes,
            "lamp": {"type": "point", "position": [0.0, 0.0, RADIUS], "intensity": np.pi * LEVEL * RADIUS**2},
            "sensor": {**tracer._sensor(), "film": {**film, "rfilter": {"type": "box"}}, "sampler": sampler},
            "integrator": path_integrator(bounces),
        }
    )
    parameters = tracer.mi.traverse(scene)
    for number, position in enumerate(positions):
        parameters["lamp.position"] = position.tolist()
        parameters.update()
        yield to_bytes(encode(np.array(tracer.mi.render(scene, seed=number))))


def write_capture(folder: Path, mesh: Mesh, size: int, count: int, samples: int, bounces: int, gloss: bool) -> Maps:
    """Writes a path-traced capture of a mesh, in the axes of the camera, and returns its true maps.

    Args:
        folder: of the capture, a new one.
        mesh: aligned.
        size: of the frames, pixels.
        count: of the lamps.
        samples: paths per pixel.
        bounces: of interreflection.
        gloss: whether glossy materials reflect.
    """
    baker = Baker(mesh, 1024)
    maps, camera = baker.maps(size, 4, VIEW), baker.camera(size, VIEW)
    assert camera.pose is not None
    (folder / "frames").mkdir(parents=True)
    frames = render_frames(PathTracer(mesh, size, camera, gloss), lamps(count), samples, bounces)
    entries = []
    for number, (position, frame) in enumerate(zip(lamps(count), progress(frames, folder.name, count))):
        entries.append({"frame": f"frames/{number:03d}.png", "position": position.tolist()})
        Image.fromarray(frame).save(folder / entries[-1]["frame"])
    focal = size / 2 * camera.distance
    intrinsics = [[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]]
    extrinsics = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, camera.distance]]
    index = {"camera": {"intrinsics": intrinsics, "extrinsics": extrinsics}, "lamps": entries}
    (folder / "capture.json").write_text(json.dumps(index))
    Image.fromarray(to_bytes(maps.coverage)).save(folder / "mask.png")
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in camera.pose.to_camera(mesh.vertices.astype(np.float64))]
    lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    return maps


def compare(measured: Maps, baked: Maps) -> dict[str, float]:
    """Compares measured with baked maps; the keys are explained at the top of this file."""
    compared = binary_erosion(baked.mask & (baked.coverage == 1), iterations=EDGE) & measured.mask
    found, true = (maps.transport[compared].astype(np.float64) for maps in (measured, baked))
    product, square = (found * true).sum(1), np.maximum((found**2).sum(1), 1e-12)
    ratio = measured.albedo[compared] / np.maximum(baked.albedo[compared], 1e-3)
    cosine = np.clip((measured.normal[compared] * baked.normal[compared]).sum(1), -1, 1)

    def length(vectors: np.ndarray) -> float:
        """Returns the root mean square length of vectors (N,C)."""
        return float(np.sqrt((vectors**2).sum(1).mean()))

    return {
        "pixels": int(compared.sum()),
        "length": length(true),
        "difference": length(found - true),
        "shape": length((product / square)[:, None] * found - true),
        "factor": float(product.sum() / square.sum()),
        "albedo": float(np.sqrt(((ratio / np.median(ratio) - 1) ** 2).mean())),
        "normals": float(np.degrees(np.median(np.arccos(cosine)))),
    }


def main() -> None:
    """Prints how far the maps measured on path-traced captures are from the baked ones."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--mesh", type=Path, help="a mesh instead of a generated figure")
    parser.add_argument("--seed", type=int, default=900_001, help="of the generated figure")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--samples", type=int, default=8, help="of the path tracer, per pixel")
    parser.add_argument("--lamps", type=int, default=331)
    args = parser.parse_args()
    mesh = with_gloss(figure(args.mesh, args.seed), args.seed)
    print("| frames | pixels | length | difference | shape | factor | albedo | normals, degrees |")
    print("|---|---|---|---|---|---|---|---|")
    for name, gloss, bounces in (("matt", False, 0), ("one bounce", False, 1), ("one bounce, gloss", True, 1)):
        with TemporaryDirectory() as folder:
            capture = Path(folder, name)
            baked = write_capture(capture, mesh, args.size, args.lamps, args.samples, bounces, gloss)
            found = compare(measure_maps(read_capture(capture))[1], baked)
        print(f"| {name} | {' | '.join(f'{value:.4g}' for value in found.values())} |", flush=True)


if __name__ == "__main__":
    main()
