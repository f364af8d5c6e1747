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

from relight.meshes import Material, Mesh
from relight.sh import basis, coefficient_count
from relight.transport import PathTracer
from relight.transport.tracer import sky_directions, sky_weights

ALBEDO = 0.5  # of the whole figure
ORDERS = (2, 3, 4)  # to which the light is truncated


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
        traced, baked: (S,S,C) radiance.
        where: (S,S) bool, the pixels that are compared.
        noise: standard deviation of the traced radiance; if given, the row ends with the RMS without it.
    """
    level = traced[where].mean()
    image = (baked - traced) / level * 100
    difference = image[where]
    both = where[:, 1:] & where[:, :-1]
    structure = np.corrcoef(image[:, 1:][both].ravel(), image[:, :-1][both].ravel())[0, 1]
    rms = math.sqrt((difference**2).mean())
    row = f"| {name} | {level:.3f} | {difference.mean():+.2f} % | {rms:.2f} % | {structure:+.2f} |"
    if noise is not None:
        row += f" {math.sqrt(max(rms**2 - (100 * noise / level) ** 2, 0)):.2f} |"
    print(row, flush=True)


class Renderers:
    """A figure that is both path traced and baked.

    Attributes:
        tracer: of the figure.
        samples: paths per pixel.
        transport, bounced: (S,S,25), direct and of the first bounce.
        where: (S,S) bool, the pixels that are compared: those whose neighbours are in the mask, too.
    """

    def __init__(self, mesh: Mesh, size: int, samples: int):
        """Bakes a mesh; `size` is the side of the image, pixels."""
        from relight.transport import bake

        self.tracer, self.samples = PathTracer(mesh, size), samples
        maps = bake(mesh, size, rays=1024, order=ORDERS[-1], supersample=4, bounces=1)
        self.transport, self.bounced = maps.transport, maps.bounced[..., 0]
        self.where = binary_erosion(maps.mask, np.ones((3, 3)))

    def traced(self, sky: np.ndarray, bounces: int = 0, seed: int = 0) -> np.ndarray:
        """Returns the traced radiance (S,S,3) under a panorama at `sky_directions`."""
        return self.tracer.radiance(sky, self.samples, bounces, seed)

    def baked(self, light: np.ndarray, bounces: int = 0) -> np.ndarray:
        """Returns the baked radiance (S,S,3) under a light (K,3), without or with one bounce."""
        transport = self.transport + self.bounced if bounces else self.transport
        return ALBEDO / np.pi * transport[..., : len(light)] @ light


def main() -> None:
    """Traces and bakes a figure under three kinds of light, and prints a table for each."""
    from transport import figure, machine

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--mesh", type=Path, help="a mesh instead of a generated figure")
    parser.add_argument("--seed", type=int, default=0, help="of the generated figure and room")
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--samples", type=int, default=400, help="of the path tracer, per pixel")
    parser.add_argument("--out", type=Path, help="picture (.png)")
    options = parser.parse_args()

    mesh = figure(options.mesh, options.seed)
    mesh.materials, mesh.color = [Material(np.full(3, ALBEDO, np.float32))], None
    mesh.material = np.zeros(len(mesh.faces), np.int16)
    renderers = Renderers(mesh, options.size, options.samples)
    pixels = renderers.where.sum()
    print(f"{machine()}; {len(mesh.faces)} triangles, {pixels} pixels, {options.samples} samples per pixel\n")
    compare_coefficients(renderers)
    sky = panorama(options.seed)
    coefficients = np.einsum("hw,hwk,hwc->kc", sky_weights(), basis(sky_directions(), ORDERS[-1]), sky)
    limited, baked = compare_limited(renderers, coefficients[:9])
    truth = compare_orders(renderers, sky, coefficients)
    if options.out:
        level = limited[renderers.where].mean()
        error = np.where(renderers.where[..., None], 0.5 + 5 * (baked - limited) / level, 0.5)  # 0 is grey
        pictures = [limited, baked, error.clip(0, 1) ** 2.2, truth]
        pictures += [renderers.baked(coefficients[: coefficient_count(order)]) for order in (2, 4)]
        plate(pictures, limited[renderers.where].max(), options.out)


def compare_coefficients(renderers: Renderers) -> None:
    """Compares under a constant light plus one harmonic per color channel, and prints the table."""
    print("Light: a constant plus one harmonic per color channel, so that each coefficient is tested alone\n")
    print("| coefficient | traced mean | mean difference | RMS difference | correlation |\n|---|---|---|---|---|")
    for first in (0, 3, 6):
        light = np.zeros((9, 3))
        light[0] = 1.5 * math.sqrt(4 * math.pi)  # radiance 1.5, above the largest value of a harmonic
        light[range(first, first + 3), range(3)] += 1
        traced, baked = renderers.traced(basis(sky_directions()) @ light), renderers.baked(light)
        for channel in range(3):
            part = np.s_[..., channel : channel + 1]
            compare(str(first + channel), traced[part], baked[part], renderers.where)


def compare_limited(renderers: Renderers, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compares under a light (9,3), raised to be positive everywhere, and prints the table.

    Returns:
        The traced and the baked radiance (S,S,3) without bounces.
    """
    harmonics = basis(sky_directions())
    lowest = (harmonics @ light).min()
    light = light.copy()
    light[0] += max(0, 0.01 - lowest) * math.sqrt(4 * math.pi)  # a path tracer needs positive light
    print(f"\nLight: a room, band-limited to order 2 and raised by {max(0, -lowest):.2f} to be positive")
    print("\n| | traced mean | mean difference | RMS difference | correlation |\n|---|---|---|---|---|")
    limited, baked = renderers.traced(harmonics @ light), renderers.baked(light)
    compare("direct", limited, baked, renderers.where)
    with_bounce = renderers.traced(harmonics @ light, bounces=1)
    compare("one bounce", with_bounce, renderers.baked(light, bounces=1), renderers.where)
    return limited, baked


def compare_orders(renderers: Renderers, sky: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Compares the traced picture under a panorama with those baked to each of ORDERS, and prints the table.

    Args:
        renderers: of the figure.
        sky: the panorama at `sky_directions`.
        coefficients: (25,3) of the panorama.

    Returns:
        The traced radiance (S,S,3).
    """
    halves = [renderers.traced(sky, seed=seed) for seed in (1, 2)]
    truth, noise = (halves[0] + halves[1]) / 2, float((halves[0] - halves[1])[renderers.where].std() / 2)
    print(f"\nLight: the room itself; the last column is the RMS without the tracer's noise ({noise:.4f}), in percent")
    print("\n| order | traced mean | mean difference | RMS difference | correlation | truncation |")
    print("|---|---|---|---|---|---|")
    for order in ORDERS:
        baked = renderers.baked(coefficients[: coefficient_count(order)])
        compare(str(order), truth, baked, renderers.where, noise)
    return truth


def plate(pictures: list[np.ndarray], white: float, path: Path) -> None:
    """Writes pictures side by side, at twice their size, by a display's gamma of 2.2.

    Args:
        pictures: (S,S,3) radiance: traced, baked, five times their relative difference (in [0,1]); traced, order 2,
            order 4.
        white: the radiance that is displayed as white.
        path: the picture.
    """
    from PIL import Image

    columns = np.flatnonzero(pictures[0].sum((0, 2)) > 0)
    crop = np.s_[:, columns[0] : columns[-1] + 1]
    whites = [white, white, 1, white, white, white]
    coded = [np.clip(picture[crop] / level, 0, 1) ** (1 / 2.2) for picture, level in zip(pictures, whites)]
    strip = (np.concatenate(coded, axis=1) * 255).round().astype(np.uint8).repeat(2, axis=0).repeat(2, axis=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(strip).save(path)


if __name__ == "__main__":
    main()
