"""The baked maps against Mitsuba 3, a path tracer that shares no code with them, and what truncating the light costs.

    python benchmarks/path_tracing.py --out docs/images/path_tracing.png

Mitsuba renders a clothed figure of albedo .5 under a panorama band-limited to order 2, pixel by pixel the mean over
the pixel's area; the baked side is albedo / pi * (T . L), baked at twice the size and averaged down. Then both under
the panorama as it is: the difference is what orders 2, 3 and 4 cannot hold. The same with one bounce.
"""

import argparse
import math
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np
import trimesh

from relight.meshes.mesh import Material, Mesh
from relight.meshes.normals import vertex_normals
from relight.sh.basis import basis

mi.set_variant("scalar_rgb")  # slower than llvm, but needs no LLVM on the machine
ROWS = 256


def sky_directions() -> np.ndarray:
    """Directions (ROWS, 2 ROWS, 3) of the texels of a Mitsuba environment map, in our frame.

    Measured on mi.load_dict({"type": "envmap"}).eval: rows run from pole to pole inclusive, columns are centres, and
    u = 1/4 is +x, u = 1/2 is +z.
    """
    theta = np.linspace(0, np.pi, ROWS)[:, None]
    phi = 2 * np.pi * ((np.arange(2 * ROWS) + 0.5) / (2 * ROWS))[None]
    return np.stack([np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi, -np.sin(theta) * np.cos(phi)], -1)


def path_trace(mesh: Mesh, sky: np.ndarray, size: int, samples: int, bounces: int = 0, seed: int = 0) -> np.ndarray:
    """Radiance (size, size, 3) of the aligned mesh with its first material's colour, under `sky` (ROWS, 2 ROWS, 3)."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.ply"
        trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=vertex_normals(mesh), process=False).export(
            path, vertex_normal=True
        )
        color = {"type": "rgb", "value": [float(c) for c in mesh.materials[0].color]}
        scene = mi.load_dict(
            {
                "type": "scene",
                "light": {"type": "envmap", "bitmap": mi.Bitmap(sky.astype(np.float32))},
                "shape": {
                    "type": "ply",
                    "filename": str(path),
                    "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}},
                },
                "sensor": {
                    "type": "orthographic",
                    "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 4], target=[0, 0, 0], up=[0, 1, 0]),
                    "film": {
                        "type": "hdrfilm",
                        "width": size,
                        "height": size,
                        "rfilter": {"type": "box"},
                        "pixel_format": "rgb",
                        "component_format": "float32",
                    },
                    "sampler": {"type": "multijitter", "sample_count": samples},
                },
                "integrator": {"type": "path", "max_depth": 2 + bounces, "rr_depth": 100, "hide_emitters": True},
            }
        )
        return np.array(mi.render(scene, seed=seed))


def averaged(image: np.ndarray, k: int) -> np.ndarray:
    """The mean over k x k blocks of (H, W, ...)."""
    height, width = image.shape[0] // k, image.shape[1] // k
    return image.reshape(height, k, width, k, *image.shape[2:]).mean((1, 3))


def inside(mask: np.ndarray, k: int) -> np.ndarray:
    """Pixels whose k x k block lies in the mask, and those of their eight neighbours too."""
    full = averaged(mask.astype(float), k) == 1
    padded = np.pad(full, 1)
    rows, columns = full.shape
    return np.all([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], 0)


def panorama(seed: int) -> np.ndarray:
    """A generated room on Mitsuba's texels, (ROWS, 2 ROWS, 3), scaled to mean radiance 1."""
    from relight.panoramas.rooms import room

    pixels = room(seed)  # lat-long: the centre looks along -z, +x is to its right
    height, width = pixels.shape[:2]
    x, y, z = np.moveaxis(sky_directions(), -1, 0)
    row = np.clip(np.arccos(np.clip(y, -1, 1)) / np.pi * height, 0, height - 1).astype(int)
    column = (np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width
    sky = pixels[row, np.clip(column, 0, width - 1).astype(int)]
    return sky / (sky * weights()[..., None]).sum() * 3 * 4 * np.pi


def weights() -> np.ndarray:
    """Solid angle of each texel, (ROWS, 2 ROWS); sums to 4 pi."""
    sine = np.sin(np.linspace(0, np.pi, ROWS))
    return np.repeat((sine / sine.sum() * 2 * np.pi / ROWS)[:, None], 2 * ROWS, 1)


def compare(name: str, traced: np.ndarray, baked: np.ndarray, where: np.ndarray, noise: float | None = None) -> None:
    """A row: mean and RMS difference over pixels and channels, in percent of the traced mean, and the correlation of
    the difference with that of the pixel to the right: 0 for noise, near 1 for structure."""
    level = traced[where].mean()
    image = (baked - traced) / level * 100
    difference = image[where]
    both = where[:, 1:] & where[:, :-1]
    structure = np.corrcoef(image[:, 1:][both].ravel(), image[:, :-1][both].ravel())[0, 1]
    rest = "" if noise is None else f" {math.sqrt(max(difference.std() ** 2 - (100 * noise / level) ** 2, 0)):.2f} |"
    print(
        f"| {name} | {level:.3f} | {difference.mean():+.2f} % | {difference.std():.2f} % | {structure:+.2f} |{rest}",
        flush=True,
    )


def main() -> None:
    from transport import figure, machine

    from relight.transport.bake import bake

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--mesh", type=Path, help="a mesh instead of a generated figure")
    parser.add_argument("--seed", type=int, default=0, help="of the generated figure and room")
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--samples", type=int, default=400, help="of the path tracer, per pixel")
    parser.add_argument("--out", type=Path, help="picture (.png)")
    options = parser.parse_args()
    size, samples, albedo = options.size, options.samples, 0.5

    mesh = figure(options.mesh, options.seed)
    mesh.materials, mesh.color = [Material(np.full(3, albedo, np.float32))], None
    mesh.material = np.zeros(len(mesh.faces), np.int16)
    maps = bake(mesh, 2 * size, 256, order=4, bounces=1)
    transport, where = averaged(maps.transport, 2), inside(maps.mask, 2)
    bounced = averaged(maps.bounced[..., 0], 2)
    print(f"{machine()}; {len(mesh.faces)} triangles, {where.sum()} pixels, {samples} samples per pixel\n")

    def shade(light: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        return albedo / np.pi * vectors[..., : len(light)] @ light

    print("Light: a constant plus one harmonic per colour channel, so that each coefficient is tested alone\n")
    print("| coefficient | traced mean | mean difference | RMS difference | correlation |\n|---|---|---|---|---|")
    values = basis(sky_directions())
    for first in (0, 3, 6):
        light = np.zeros((9, 3))
        light[0] = 1.5 * math.sqrt(4 * math.pi)
        light[range(first, first + 3), range(3)] += 1
        traced = path_trace(mesh, values @ light, size, samples)
        baked = shade(light, transport)
        for channel in range(3):
            part = np.s_[..., channel : channel + 1]
            compare(str(first + channel), traced[part], baked[part], where)

    sky = panorama(options.seed)
    full = np.einsum("hw,hwk,hwc->kc", weights(), basis(sky_directions(), 4), sky)
    light = full[:9].copy()
    lowest = (values @ light).min()
    light[0] += max(0, 0.01 - lowest) * math.sqrt(4 * math.pi)  # a path tracer takes no negative light
    print("\nLight: a room, band-limited to order 2" + f" and raised by {max(0, -lowest):.2f} to be positive")
    print("\n| | traced mean | mean difference | RMS difference | correlation |\n|---|---|---|---|---|")
    limited = path_trace(mesh, values @ light, size, samples)
    compare("direct", limited, shade(light, transport), where)
    compare("one bounce", path_trace(mesh, values @ light, size, samples, 1), shade(light, transport + bounced), where)

    halves = [path_trace(mesh, sky, size, samples, seed=seed) for seed in (1, 2)]
    truth, noise = (halves[0] + halves[1]) / 2, float((halves[0] - halves[1])[where].std() / 2)
    print(f"\nLight: the room itself; the last column is the RMS without the tracer's noise ({noise:.4f}), in percent")
    print("\n| order | traced mean | mean difference | RMS difference | correlation | truncation |")
    print("|---|---|---|---|---|---|")
    for order in (2, 3, 4):
        compare(str(order), truth, shade(full[: (order + 1) ** 2], transport), where, noise)
    if options.out:
        ours = shade(light, transport)
        error = np.where(where[..., None], 0.5 + 5 * (ours - limited) / limited[where].mean(), 0.5)
        pictures = [limited, ours, error.clip(0, 1) ** 2.2, truth]
        pictures += [shade(full[: (n + 1) ** 2], transport) for n in (2, 4)]
        plate(pictures, limited[where].max(), options.out)


def plate(pictures: list[np.ndarray], white: float, path: Path) -> None:
    """Side by side: traced, baked, five times their relative difference about grey; then traced, order 2, order 4."""
    from PIL import Image

    columns = np.flatnonzero(pictures[0].sum((0, 2)) > 0)
    crop = np.s_[:, columns[0] : columns[-1] + 1]
    scale = [white, white, 1, white, white, white]
    strip = np.concatenate([np.clip(picture[crop] / s, 0, 1) ** (1 / 2.2) for picture, s in zip(pictures, scale)], 1)
    strip = (strip * 255).round().astype(np.uint8).repeat(2, 0).repeat(2, 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(strip).save(path)


if __name__ == "__main__":
    main()
