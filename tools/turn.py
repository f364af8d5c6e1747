"""Draws the pictures of a photograph under a lamp that moves from side to side: docs/images/turn.webp and turn.jpg.

The first is README's, the second a strip of it for pages that show no animation.

python tools/turn.py [photo]
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import relight
from relight.photos.look import Look

ROOT = Path(__file__).resolve().parents[1]
PHOTO, OUT = ROOT / "relight" / "viewer" / "web" / "astronaut.jpg", ROOT / "docs" / "images"
LIGHT, SIDE = "key:#ffd0a0@0,20,0.12", 80  # a warm lamp, and how far it goes to each side, degrees
FRAMES, MILLISECONDS = 36, 110
STRIP = (0, 5, 9, 13, 18)  # frames from the right to the left
HEIGHT = 300  # of the strip, pixels


def main(photo: Path = PHOTO) -> None:
    """Draws both."""
    look = Look(LIGHT)
    scene = relight.load().scene(photo, size=512)
    turns = np.radians(SIDE) * np.cos(2 * np.pi * np.arange(FRAMES) / FRAMES)
    frames = [Image.fromarray(frame) for frame in scene.turned(look, scene.exposed(look), turns.tolist())]
    first, *rest = frames
    first.save(OUT / "turn.webp", save_all=True, append_images=rest, duration=MILLISECONDS, loop=0, quality=80)
    small = [frames[n].resize((round(first.width * HEIGHT / first.height), HEIGHT)) for n in reversed(STRIP)]
    Image.fromarray(np.concatenate([np.asarray(each) for each in small], 1)).save(OUT / "turn.jpg", quality=88)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
