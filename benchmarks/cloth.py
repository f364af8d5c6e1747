"""Compares the roughness of generated clothes with photographs: variation of log luminance by wavelength.

    python benchmarks/cloth.py --seeds 5000-5009

Each figure is baked at 768 px, where a person is 691 px high (2.5 mm a pixel), and lit by generated rooms (order 2).
Roughness is the standard deviation over a garment of the difference of two Gaussian blurs of ln luminance, for three
pairs of Gaussians: of the picture, of its shading alone, and of its albedo alone, as medians over garments of a kind or
a fabric. The last rows are photographs (one garment each, hand-picked boxes, with tone curve and sharpening) and the
cloth of real scans. AO is the mean over all pixels; `lost` is the RMS of |T - T without occlusion|.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported, see transport.py

import argparse
import json
import time
import warnings
from collections import defaultdict

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from relight.figures import dress
from relight.figures.assembly import Assembly
from relight.figures.commands import seeds_of
from relight.figures.tailor.garments import group
from relight.meshes import Mesh
from relight.sh import unoccluded
from relight.srgb import LUMINANCE
from relight.transport import bake
from relight.transport.baker import primary_hits
from relight.transport.camera import Camera
from relight.transport.raycaster import RayCaster

SIGMAS = ((0.7, 1.4), (1.4, 2.8), (2.8, 5.6))  # pixels: wavelengths around 14, 27 and 55 mm of a person 691 px high
SIZE = 768  # pixels of the image
MIN_PIXELS = 400  # of a garment to measure
ROOMS = (3, 11, 19, 27)
PHOTOGRAPHS = {
    "dress": (0.084, 0.129, 0.193),
    "denim trousers": (0.119, 0.109, 0.098),
    "coat, jacket": (0.083, 0.078, 0.073),
}
SCANS = (0.037, 0.069)  # range of the albedo alone, in the finest band


def roughness(luminance: np.ndarray, mask: np.ndarray) -> list[float]:
    """Returns the standard deviation of ln luminance (H,W) in the mask (H,W), between the Gaussians of each of SIGMAS.

    The Gaussians are normalised, so that pixels outside the mask have no effect, and the mask is eroded by 1.5 of the
    larger sigma. NaN if fewer than MIN_PIXELS pixels remain.
    """
    inside = mask.astype(float)
    log = np.log(np.maximum(luminance, 0.01 * np.median(luminance[mask]))) if mask.any() else np.zeros_like(luminance)
    depth = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]

    def blurred(sigma: float) -> np.ndarray:
        """Returns the mean (H,W) of ln luminance inside the mask by a Gaussian of `sigma` pixels."""
        return gaussian_filter(log * inside, sigma) / np.maximum(gaussian_filter(inside, sigma), 1e-9)

    out = []
    for small, large in SIGMAS:
        kept = depth > 1.5 * large
        out.append(float((blurred(small) - blurred(large))[kept].std()) if kept.sum() >= MIN_PIXELS else np.nan)
    return out


def figure(seed: int, detail: str, texture: int) -> tuple[Mesh, list[set[int]], float]:
    """Generates the figure of a seed.

    Args:
        seed: of the figure.
        detail: a key of `dress.DETAILS`.
        texture: side of the textures, pixels.

    Returns:
        The aligned mesh, the materials of each garment (indices), and the CPU seconds without the alignment.
    """
    from relight.config import composed
    from relight.meshes import align

    add, added = Assembly.add_garment, []  # `added`: for each garment its figure's builder and its materials

    def add_garment(self, *args) -> np.ndarray:
        """Adds a garment as the generator does, and records which materials it got."""
        first = len(self.builder.paints)
        positions = add(self, *args)
        added.append((self.builder, set(range(first, len(self.builder.paints)))))
        return positions

    Assembly.add_garment = add_garment
    start = time.process_time()
    try:
        mesh = dress.make_figure(seed, detail, texture)
    finally:
        Assembly.add_garment = add
    seconds = time.process_time() - start
    last = added[-1][0]  # outfits that collide are drawn again, with a new builder
    return align(mesh, composed().align), [materials for builder, materials in added if builder is last], seconds


def visible(mesh: Mesh) -> np.ndarray:
    """Returns the material (SIZE,SIZE) visible at each pixel, -1 for none."""
    caster = RayCaster(mesh.vertices, mesh.faces)
    row, column = np.divmod(np.arange(SIZE * SIZE), SIZE)
    camera = Camera(SIZE, max(2.0, float(caster.high[2]) + caster.diagonal / 100))
    pixel, face, _ = primary_hits(caster, camera, column + 0.5, row + 0.5)
    out = np.full(SIZE * SIZE, -1)
    out[pixel] = mesh.material[face]
    return out.reshape(SIZE, SIZE)


def kind(name: str, fabric: str) -> str:
    """Returns the row of the table in which a garment counts, by its name and its fabric."""
    if name in group("bottoms"):
        return "denim trousers" if fabric == "denim" else "trousers"
    groups = {
        "dress": (*group("dresses"), *group("robes")),
        "skirt": group("skirts"),
        "coat, jacket": ("jacket", "blazer", "coat", "closed jacket", "closed coat", "vest", "waistcoat"),
        "knitwear": ("sweater", "hoodie", "cardigan", "roll-neck"),
        "scarf": ("scarf", "wrapped scarf"),
    }
    return next((kind for kind, names in groups.items() if name in names), "shirt")


def lights() -> list[np.ndarray]:
    """Returns the luminance of the lights (9,) of ROOMS."""
    from relight.panoramas import Panorama, generate_room, project

    return [project(Panorama(generate_room(seed))) @ LUMINANCE for seed in ROOMS]


def main() -> None:
    """Prints the roughness of the clothes of each seed, and the medians by kind of garment."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="5000-5009")
    parser.add_argument("--detail", default="full", choices=dress.DETAILS)
    parser.add_argument("--texture", type=int, default=1024)
    parser.add_argument("--rays", type=int, default=144)
    args = parser.parse_args()
    lit, shading, bare = defaultdict(list), defaultdict(list), defaultdict(list)
    whole, seconds, sky = [], [], lights()
    for seed in seeds_of(args.seeds):
        mesh, garments, spent = figure(seed, args.detail, args.texture)
        maps = bake(mesh, SIZE, args.rays, supersample=3)
        material = visible(mesh)
        albedo = maps.albedo @ LUMINANCE
        for name, fabric, mine in zip(mesh.info["garments"], mesh.info["fabrics"], garments):
            mask = np.isin(material, list(mine))
            alone = roughness(albedo, mask)
            shades = [maps.transport @ light for light in sky]
            pair = [
                np.sqrt(np.mean([np.square(roughness(paint * shade, mask)) for shade in shades], axis=0))
                for paint in (albedo, 1.0)
            ]
            for table, key, values in zip((lit, shading, bare), [kind(name, fabric)] * 2 + [fabric], [*pair, alone]):
                table[key].append(values)
            record = {"seed": seed, "garment": name, "fabric": fabric, "lit": pair[0].round(3).tolist()}
            record |= {"shading": pair[1].round(3).tolist(), "albedo": np.round(alone, 3).tolist()}
            print(json.dumps(record), flush=True)
        lost = np.linalg.norm(maps.transport - unoccluded(maps.normal.astype(float)), axis=-1)[maps.mask]
        ao = maps.ao[maps.mask]
        whole.append([ao.mean(), (ao < 0.5).mean(), np.sqrt((lost**2).mean())])
        seconds.append(spent)
        record = {"seed": seed, "ao": np.round(whole[-1], 3).tolist(), "CPU s": round(spent, 1)}
        print(json.dumps(record | {"vertices": len(mesh.vertices), "redrawn": mesh.info["redrawn"]}), flush=True)
    for title, table, truth in (("lit", lit, PHOTOGRAPHS), ("shading alone", shading, {}), ("albedo alone", bare, {})):
        print(f"\n| {title} | garments | 14 mm | 27 mm | 55 mm |\n|---|---|---|---|---|")
        for name in sorted(table):
            print(f"| {name} | {len(table[name])} | " + " | ".join(f"{x:.3f}" for x in middle(table[name])) + " |")
        for name, values in truth.items():
            print(f"| photograph: {name} | 1 | " + " | ".join(f"{x:.3f}" for x in values) + " |")
    print(f"| cloth of scans | | {SCANS[0]}-{SCANS[1]} | | |")
    ao, dark, lost = np.mean(whole, axis=0)
    print(f"\nAO {ao:.3f}, {100 * dark:.1f} % under .5, lost {lost:.3f}; {np.mean(seconds):.1f} CPU s a figure")


def middle(rows: list) -> np.ndarray:
    """Returns the median (3,) over garments that are large enough, by band."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # no garment of this kind was large enough
        return np.nanmedian(np.array(rows, float), axis=0)


if __name__ == "__main__":
    main()
