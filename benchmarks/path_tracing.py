"""Compares baked maps with Mitsuba 3, an independent path tracer, and measures the error of truncating the light.

    python benchmarks/path_tracing.py --size 256 --samples 200 --out docs/images/path_tracing.png

Mitsuba renders a clothed figure of albedo .5 under a panorama band-limited to order 2, as means over pixels. The baked
picture is albedo / pi * (T . L), by 1,024 rays shared by 4 x 4 points of a pixel, without and with one bounce. Then the
full panorama is traced: the difference is the truncation error of orders 2, 3 and 4.
"""

import argparse
import math
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion

from relight.meshes import Material
from relight.sh import basis
from relight.transport import PathTracer
from relight.transport.tracer import sky_directions, sky_weights


def panorama(seed: int) -> np.ndarray:
    """Returns a generated room on Mitsuba's texels (256,512,3), scaled to mean radiance 1."""
    from relight.panoramas import generate_room

    pixels = generate_room(seed)  # lat-long: the centre looks along -z, +x is to its right
    height, width = pixels.shape[:2]
    x, y, z = np.moveaxis(sky_directions(), -1, 0)
    row = np.clip(np.arccos(np.clip(y, -1, 1)) / np.pi * height, 0, height - 1).astype(int)
    column = (np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width
    sky = pixels[row, np.clip(column, 0, width - 1).astype(int)]
    return sky / (sky * sky_weights()[..., None]).sum() * 3 * 4 * np.pi


def compare(name: str, traced: np.ndarray, baked: np.ndarray, where: np.ndarray, noise: float | None = None) -> None:
    """Prints a row: mean and RMS difference over pixels and channels, in percent of the traced mean.

    It also has the correlation of the difference between neighbouring pixels: 0 for noise, near 1 for structure.

    Args:
        name: of the row.
        traced: (S,S,C) radiance of the path tracer.
        baked: (S,S,C) radiance by the transport.
        where: (S,S) bool, pixels to compare.
        noise: standard deviation of the path tracer's noise, in the unit of radiance. If given, the row ends with the
            RMS difference without it.
    """
    level = traced[where].mean()
    image = (baked - traced) / level * 100
    difference = image[where]
    both = where[:, 1:] & where[:, :-1]
    structure = np.corrcoef(image[:, 1:][both].ravel(), image[:, :-1][both].ravel())[0, 1]
    rms = math.sqrt((difference**2).mean())
    rest = "" if noise is None else f" {math.sqrt(max(rms**2 - (100 * noise / level) ** 2, 0)):.2f} |"
    print(
        f"| {name} | {level:.3f} | {difference.mean():+.2f} % | {rms:.2f} % | {structure:+.2f} |{rest}",
        flush=True,
    )


def main() -> None:
    """Prints the differences of baked and traced pictures, and draws them."""
    from transport import figure, machine

    from relight.transport import bake

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
    tracer = PathTracer(mesh, size)
    maps = bake(mesh, size, rays=1024, order=4, supersample=4, bounces=1)
    transport, bounced, where = maps.transport, maps.bounced[..., 0], binary_erosion(maps.mask, np.ones((3, 3)))
    print(f"{machine()}; {len(mesh.faces)} triangles, {where.sum()} pixels, {samples} samples per pixel\n")

    def shade(light: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        """Returns the radiance (S,S,C) of a matt figure under a light (K,C), by vectors (S,S,>=K) of transport."""
        return albedo / np.pi * vectors[..., : len(light)] @ light

    print("Light: a constant plus one harmonic per color channel, so that each coefficient is tested alone\n")
    print("| coefficient | traced mean | mean difference | RMS difference | correlation |\n|---|---|---|---|---|")
    values = basis(sky_directions())
    for first in (0, 3, 6):
        light = np.zeros((9, 3))
        light[0] = 1.5 * math.sqrt(4 * math.pi)
        light[range(first, first + 3), range(3)] += 1
        traced = tracer.radiance(values @ light, samples)
        baked = shade(light, transport)
        for channel in range(3):
            part = np.s_[..., channel : channel + 1]
            compare(str(first + channel), traced[part], baked[part], where)

    sky = panorama(options.seed)
    full = np.einsum("hw,hwk,hwc->kc", sky_weights(), basis(sky_directions(), 4), sky)
    light = full[:9].copy()
    lowest = (values @ light).min()
    light[0] += max(0, 0.01 - lowest) * math.sqrt(4 * math.pi)  # a path tracer needs positive light
    print("\nLight: a room, band-limited to order 2" + f" and raised by {max(0, -lowest):.2f} to be positive")
    print("\n| | traced mean | mean difference | RMS difference | correlation |\n|---|---|---|---|---|")
    limited = tracer.radiance(values @ light, samples)
    compare("direct", limited, shade(light, transport), where)
    compare("one bounce", tracer.radiance(values @ light, samples, 1), shade(light, transport + bounced), where)

    halves = [tracer.radiance(sky, samples, seed=seed) for seed in (1, 2)]
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
    """Writes pictures side by side, at twice their size.

    Args:
        pictures: (S,S,3) each: traced, baked, five times their relative difference; traced, order 2, order 4.
        white: radiance that is white; the difference has its own scale.
        path: .png.
    """
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
