"""Draws docs/images/photo.jpg: a photograph (NASA, by scikit-image), its inferred maps, and the relit photograph.

python tools/portrait.py
python tools/portrait.py --weights old.onnx new.onnx --out both.jpg   # a row for each
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image
from skimage import data

from relight.maps.square import fill_outside
from relight.photos.api import Relighter, load
from relight.photos.background import read_background
from relight.srgb import encode, to_bytes
from relight.viewer.source import PORTRAIT_MASK

IMAGES = Path(__file__).parents[1] / "docs" / "images"
GREY = 0x80  # code of the background
LIGHTS = ("key:#ffd9a0@70,20,0.15", "key:#a8c8ff@-70,20,0.15", "room:12")


def row(relighter: Relighter, photo: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Draws what a network makes of a photo.

    Args:
        relighter: the network.
        photo: (S,S,3) uint8 sRGB.
        mask: (S,S) uint8 of the person.

    Returns:
        (S,6 S,3) uint8: the photo, its albedo, half its shading, and the photo in LIGHTS, side by side.
    """
    person = relighter.infer(photo, mask)[0]
    grey = read_background(f"#{3 * f'{GREY:02x}'}")
    relit = [relighter.relight(photo, mask, light, background=grey) for light in LIGHTS]
    inside = person.coverage[..., None] / 255
    shown = []
    for values in (person.albedo, person.shading / 2):
        placed = np.zeros(photo.shape)
        placed[person.crop.window] = person.crop.place(fill_outside(values, person.mask))
        shown.append(np.uint8(to_bytes(encode(placed)) * inside + GREY * (1 - inside)))
    return np.concatenate([photo, *shown, *(picture[..., :3] for picture in relit)], axis=1)


def main() -> None:
    """Draws a row for each network, at half the size of the photo."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path, nargs="+", default=[None], help="by default those that ship")
    parser.add_argument("--out", type=Path, default=IMAGES / "photo.jpg")
    args = parser.parse_args()
    photo, mask = data.astronaut(), np.asarray(Image.open(PORTRAIT_MASK))
    sheet = np.concatenate([row(load(path), photo, mask) for path in args.weights])
    half = (sheet.shape[1] // 2, sheet.shape[0] // 2)
    Image.fromarray(sheet).resize(half, Image.Resampling.LANCZOS).save(args.out, quality=90)


if __name__ == "__main__":
    main()
