"""Makes docs/images/photo.jpg: a photograph (NASA, by scikit-image), what is inferred of it, and it in other lights.

python workflow/scripts/portrait.py [--weights FILE] [--out FILE.jpg]
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image
from skimage import data

from relight.photos.api import load
from relight.photos.background import background
from relight.srgb import encode, to_bytes

IMAGES = Path(__file__).parents[2] / "docs" / "images"
LIGHTS = ("key:#ffd9a0@70,20,0.15", "key:#a8c8ff@-70,20,0.15", "room:12")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--out", type=Path, default=IMAGES / "photo.jpg")
    args = parser.parse_args()
    relighter = load(args.weights)
    photo, mask = data.astronaut(), np.asarray(Image.open(IMAGES / "astronaut_mask.png"))
    person = relighter.infer(photo, mask)[0]
    grey = background("#808080")
    relit = [relighter.relight(photo, mask, light, behind=grey) for light in LIGHTS]
    maps = [to_bytes(encode(np.clip(m, 0, 1))) for m in (person.albedo, person.shading / 2)]
    side = photo.shape[0]
    shown = []
    for values in maps:
        behind = np.where(person.mask[..., None], values, 128).astype(np.uint8)
        shown.append(np.asarray(Image.fromarray(behind).resize((side, side), Image.Resampling.LANCZOS)))
    sheet = np.concatenate([photo, *shown, *(picture[..., :3] for picture in relit)], 1)
    Image.fromarray(sheet).resize((sheet.shape[1] // 2, side // 2), Image.Resampling.LANCZOS).save(args.out, quality=90)


if __name__ == "__main__":
    main()
