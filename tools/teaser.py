"""Draws docs/images/teaser.jpg: pictures of figures, albedo, transport, and relit pictures.

python tools/teaser.py [seed ...]
"""

import sys

import numpy as np
from omegaconf import OmegaConf
from PIL import Image

from relight import srgb
from relight.config import ROOT, composed
from relight.figures.dress import make_figure
from relight.lights import lit_ball, load_light
from relight.meshes import align, clean
from relight.transport import bake

SIZE, WIDTH = 448, 224  # height and width of a picture, pixels
PAPER = 0.97  # sRGB code of the background
BRIGHTNESS = 0.8  # reference brightness of the lights
MAX_BAND_1 = 1.03  # of transport: its value where nothing is occluded and the normal points along the axis
LIGHTS = ("room:7", "sky:5:40", "key:#a9c6ff@-75,10", "key:#ffd9b0@60,20")


def main(seeds: list[int]) -> None:
    """Draws a row for the figure of each seed: lit, albedo, AO, band 1 of transport, and in three more lights."""
    settings = OmegaConf.to_object(composed())
    lights = [load_light(text).normalised(BRIGHTNESS).coefficients for text in LIGHTS]
    rows = []
    for seed in seeds:
        mesh = make_figure(seed, detail="full", texture=1024)
        maps = bake(align(clean(mesh, settings.clean), settings.align), 2 * SIZE, rays=256)
        relit = [srgb.encode(maps.albedo * (maps.transport @ light)) for light in lights]
        ao = maps.ao[..., None].repeat(3, -1)
        band_1 = (maps.transport[..., [3, 1, 2]] / MAX_BAND_1 + 1) / 2  # x, y, z as red, green, blue
        views = [relit[0], srgb.encode(maps.albedo), ao, band_1, *relit[1:]]
        middle = SIZE // 2
        shown = slice(middle - WIDTH // 2, middle + WIDTH // 2)
        pictures = [halved(np.where(maps.mask[..., None], view, PAPER))[:, shown] for view in views]
        for picture, light in zip([pictures[0], *pictures[4:]], lights):  # the relit ones
            add_ball(picture, light)
        rows.append(np.concatenate(pictures, axis=1))
    sheet = np.concatenate(rows)
    path = ROOT / "docs" / "images" / "teaser.jpg"
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(srgb.to_bytes(sheet)).save(path, quality=88, optimize=True)


def halved(picture: np.ndarray) -> np.ndarray:
    """Returns a picture at half the size, by means over 2 x 2 pixels."""
    height, width = picture.shape[:2]
    return picture.reshape(height // 2, 2, width // 2, 2, -1).mean((1, 3))


def add_ball(picture: np.ndarray, light: np.ndarray) -> None:
    """Draws a ball in a light (9,3) into the lower right corner of a picture (H,W,3), in place."""
    size = SIZE // 9
    drawn = lit_ball(light, size)
    corner = picture[-size:, -size:]
    corner[:] = drawn[..., :3] * drawn[..., 3:] + corner * (1 - drawn[..., 3:])


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [45, 22])
