"""Measures the built-in mask on generated figures in front of backgrounds, whose true coverage is known.

    python benchmarks/masks.py FOLDER [--sheet masks.jpg]

FOLDER contains baked figures (.exr, of `relight bake` or a run's `maps/`). Each is lit by a generated room and
composited over the view of another one at a random place and size, with noise, as a JPEG of 1000 x 1250. Prints, for
the automatic mask after each step and for the true one cut to two values and fitted: the mean and least intersection
over union at half coverage, the fraction of the figure that is missed, the fraction of the mask that is background, and
the error of the coverage within 6 pixels of the silhouette; and CPU-seconds. The network was trained on photographs,
which are easier for it.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import io
import math
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from scipy.ndimage import distance_transform_edt

from relight.core.srgb import to_bytes
from relight.lights import load_light
from relight.maps import read_maps
from relight.photos.backdrop import camera_view
from relight.photos.mask import selfie
from relight.photos.mask.edge import fit_edge
from relight.photos.render import over
from relight.photos.tone import roll_off
from relight.pictures.codes import to_srgb8

SHAPE = 1250, 1000  # height and width of a picture, pixels
STRIP = 600, 250  # width and height of a picture with its masks in the sheet, pixels
BLUR = 1.0  # of the background, degrees; generated rooms are sharper than real backgrounds
RIM = 6  # pixels on both sides of the silhouette
GRAIN = 2.5  # standard deviation of the noise, in 8-bit codes


def render_picture(path: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Renders a picture of a figure in front of a background.

    Args:
        path: maps of the figure (.exr).
        number: of the picture, from which its lights and its framing are drawn.

    Returns:
        The picture (H,W,3) uint8, and the true coverage (H,W) in [0,1].
    """
    rng = np.random.default_rng(number)
    maps, light = read_maps(path), load_light(f"room:{100 + number}")
    shading = np.maximum(maps.transport @ light.coefficients.astype(np.float32), 0)
    lit = maps.albedo * shading / np.percentile(shading[maps.mask], 90)
    side = rng.uniform(0.6, 1.25) * SHAPE[1]
    left, top = rng.uniform(-0.1, 0.1) * SHAPE[1] + (SHAPE[1] - side) / 2, rng.uniform(0.3, 0.9) * (SHAPE[0] - side)
    background = load_light(f"room:{300 + number}").panorama
    view = camera_view(background, SHAPE, rng.uniform(0, 2 * np.pi), BLUR)
    view = roll_off(view * rng.uniform(0.15, 0.5) / view.mean())

    def placed(image: np.ndarray) -> np.ndarray:
        """Returns an image (S,S) of the figure at its place in the picture, (H,W) float32."""
        scale = len(image) / side
        box = (-left * scale, -top * scale, (SHAPE[1] - left) * scale, (SHAPE[0] - top) * scale)
        coefficients = (scale, 0, box[0], 0, scale, box[1])
        moved = Image.fromarray(np.ascontiguousarray(image, np.float32))
        return np.asarray(moved.transform(SHAPE[::-1], Image.Transform.AFFINE, coefficients, Image.Resampling.BICUBIC))

    alpha = np.clip(placed(maps.coverage), 0, 1)
    premultiplied = np.stack([placed(lit[..., c] * maps.coverage) for c in range(3)], -1)
    front = premultiplied / np.maximum(alpha, 1e-3)[..., None]
    picture = to_srgb8(over(roll_off(np.maximum(front, 0)), alpha, view)) + rng.normal(scale=GRAIN, size=(*SHAPE, 3))
    file = io.BytesIO()
    Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8)).save(file, "JPEG", quality=88)
    return np.asarray(Image.open(file)), alpha


def compare(mask: np.ndarray, true: np.ndarray) -> tuple[float, float, float, float]:
    """Compares a mask with the true coverage.

    Args:
        mask, true: (H,W) in [0,1].

    Returns:
        Intersection over union, fraction of the figure missed, and fraction of the mask that is background, both at
        half; and root of the mean squared error within RIM pixels of the silhouette.
    """
    inside, figure = mask > 0.5, true > 0.5
    both = (inside & figure).sum()
    rim = distance_transform_edt(figure) + distance_transform_edt(~figure) <= RIM
    error = np.sqrt(np.mean((mask - true)[rim] ** 2))
    return both / max((inside | figure).sum(), 1), 1 - both / figure.sum(), 1 - both / max(inside.sum(), 1), error


def masks(pixels: np.ndarray, true: np.ndarray) -> dict[str, np.ndarray]:
    """Returns masks (H,W) in [0,1]: of two values from the true coverage, and the automatic one after each step."""
    size = pixels.shape[1], pixels.shape[0]
    once = Image.fromarray(selfie.predict(pixels, (0, 0, *size))).resize(size, Image.Resampling.BICUBIC)
    hard = np.where(true > 0.5, np.uint8(255), np.uint8(0))
    automatic = selfie.segment(pixels)
    return {
        "given, of two values": hard / 255.0,
        "given, its edge fitted": fit_edge(pixels, hard) / 255.0,
        "one pass": np.clip(once, 0, 1),
        "three passes": selfie.segment_coarsely(pixels),
        "edge moved to the photo's": automatic / 255.0,
        "as relight uses it": fit_edge(pixels, automatic, automatic=True) / 255.0,
    }


def main() -> None:
    """Prints a row for each step, and draws all masks if `--sheet` is given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sheet", type=Path, help="A picture of all masks, the worst first.")
    parser.add_argument("--count", type=int, default=24)
    args = parser.parse_args()
    torch.set_num_threads(1)
    rows: dict[str, list] = {}  # by step, the measures of `compare` for each picture
    strips, seconds = [], []
    for number, path in enumerate(sorted(args.folder.rglob("*.exr"))[: args.count]):
        pixels, true = render_picture(path, number)
        start = time.process_time()
        selfie.segment(pixels)
        seconds.append(time.process_time() - start)
        for name, mask in masks(pixels, true).items():
            rows.setdefault(name, []).append(compare(mask, true))
        darkened = np.where(mask[..., None] > 0.5, pixels, pixels // 3)  # by the mask of the last step
        errors = to_bytes(np.dstack([mask, true, true]))  # red where it is too large, cyan where it is too small
        iou = rows[name][-1][0]
        strips.append((iou, np.concatenate([pixels, darkened, errors], axis=1)))
    print("| mask | IoU, mean | least | missed | background in it | error at the rim |\n|---|---|---|---|---|---|")
    for name, values in rows.items():
        union, missed, extra, rim = np.mean(values, axis=0)
        least = min(values)[0]
        print(f"| {name} | {union:.3f} | {least:.3f} | {missed:.3f} | {extra:.3f} | {rim:.3f} |")
    print(f"{len(seconds)} pictures; {np.median(seconds):.2f} CPU-seconds each")
    if args.sheet:
        strips.sort(key=lambda pair: pair[0])
        width, height = STRIP
        page = Image.new("RGB", (2 * width, height * math.ceil(len(strips) / 2)))
        for i, (_, strip) in enumerate(strips):
            page.paste(Image.fromarray(strip).resize(STRIP), (width * (i % 2), height * (i // 2)))
        page.save(args.sheet)


if __name__ == "__main__":
    main()
