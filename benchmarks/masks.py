"""Measures the built-in masks on generated figures in front of backgrounds, whose true coverage is known.

    python benchmarks/masks.py FOLDER [--first N]

FOLDER contains baked figures (.exr, of `relight bake` or a run's `maps/`). Pictures of KINDS are made of them: each
figure is lit by a generated room and composited over the view of another one at a random place and size, with noise, as
a JPEG of 800 x 1000. Prints, for each kind, the selfie network's mask alone, the pose network's alone, and what
`relight photo` uses: mean and least intersection over union at half coverage, and the share below .9; then how often
the number of people is right, how often wrong masks (RIGHT) are called doubtful, and CPU-seconds. The networks were
trained on photographs, which are easier for them.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import io
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np
from PIL import Image

from relight.lights import load_light
from relight.maps import Maps, read_maps
from relight.photos.backdrop import camera_view
from relight.photos.mask import selfie
from relight.photos.mask.people import mask_doubts, split_people
from relight.photos.render import over
from relight.photos.tone import roll_off
from relight.pictures.codes import to_srgb8

KINDS = {"stands": 20, "jumps": 8, "bust": 8, "dark on dark": 6, "two who touch": 7, "two apart": 5}  # numbers of them
SHAPE = 1000, 800  # height and width of a picture, pixels
BLUR = 1.0  # of the background, degrees; generated rooms are sharper than real backgrounds
RIGHT = 0.93  # least intersection over union of a mask that is right
GRAIN = 2.5  # standard deviation of the noise, in 8-bit codes


def render_picture(figures: list[Maps], kind: str, number: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Renders a picture of one figure or two in front of a background.

    Args:
        figures: two.
        kind: one of KINDS.
        number: of the picture, from which its lights and its framing are drawn.

    Returns:
        The picture (H,W,3) uint8, and the true coverage (H,W) in [0,1] of each person.
    """
    rng = np.random.default_rng(number)
    height, width = SHAPE
    light, dark = load_light(f"room:{100 + number}"), 0.06 if kind == "dark on dark" else 1
    background = load_light(f"room:{300 + number}").panorama
    view = camera_view(background, SHAPE, rng.uniform(0, 2 * np.pi), BLUR)
    picture = roll_off(view * dark * rng.uniform(0.15, 0.5) / view.mean())
    side = rng.uniform(0.75, 1.15) * width
    middle = rng.uniform(0.45, 0.55) * width
    top, turn = rng.uniform(0.3, 0.95) * (height - side), 0.0
    places = [(middle, top)]
    if kind == "jumps":
        turn, side = rng.choice([-1, 1]) * rng.uniform(0.25, 0.8), 0.8 * width
    elif kind == "bust":
        side = rng.uniform(1.9, 2.6) * width
        places = [(middle, rng.uniform(0.02, 0.12) * height)]
    elif kind.startswith("two"):
        apart = rng.uniform(0.24, 0.3) * side if kind == "two who touch" else rng.uniform(0.45, 0.5) * width
        side = side if kind == "two who touch" else 0.75 * width
        places = [(middle - apart / 2, top), (middle + apart / 2, top + rng.uniform(-0.05, 0.05) * side)]
    people: list[np.ndarray] = []
    for maps, (x, y) in zip(figures, places):
        shading = np.maximum(maps.transport[..., :9] @ light.coefficients.astype(np.float32), 0)
        lit = dark * maps.albedo * shading / np.percentile(shading[maps.mask], 90)
        scale = len(maps.albedo) / side
        axes = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        start = len(maps.albedo) / 2 - axes @ [x, y + side / 2]

        def placed(image: np.ndarray, axes=axes, start=start) -> np.ndarray:
            """Returns an image (S,S) of the figure at its place in the picture, (H,W) float32."""
            coefficients = (*axes[0], start[0], *axes[1], start[1])
            moved = Image.fromarray(np.ascontiguousarray(image, np.float32))
            return np.asarray(
                moved.transform((width, height), Image.Transform.AFFINE, coefficients, Image.Resampling.BICUBIC)
            )

        alpha = np.clip(placed(maps.coverage), 0, 1)
        premultiplied = np.stack([placed(lit[..., c] * maps.coverage) for c in range(3)], -1)
        picture = over(roll_off(np.maximum(premultiplied / np.maximum(alpha, 1e-3)[..., None], 0)), alpha, picture)
        people = [each * (1 - alpha) for each in people] + [alpha]
    codes = to_srgb8(picture) + rng.normal(scale=GRAIN, size=(height, width, 3))
    file = io.BytesIO()
    Image.fromarray(np.clip(codes, 0, 255).astype(np.uint8)).save(file, "JPEG", quality=88)
    return np.asarray(Image.open(file)), people


def overlap(mask: np.ndarray, true: np.ndarray) -> float:
    """Returns the intersection over union of two masks (H,W) bool."""
    return float((mask & true).sum() / max((mask | true).sum(), 1))


def main() -> None:
    """Prints a row for each kind of picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=0, help="number of the first picture: others make other sets")
    arguments = parser.parse_args()
    files = sorted(arguments.folder.rglob("*.exr"))
    rows, seconds, judged = [], [], []
    for number, kind in enumerate((kind for kind, count in KINDS.items() for _ in range(count)), arguments.first):
        figures = [read_maps(files[index % len(files)]) for index in (number, 7 * number + 3)]
        pixels, people = render_picture(figures, kind, number)
        true = np.maximum.reduce(people) > 0.5
        start = time.process_time()
        found, bodies = selfie.segment(pixels)
        seconds.append(time.process_time() - start)
        posed = np.maximum.reduce([np.zeros(true.shape), *(body.mask(true.shape[::-1]) for body in bodies)])
        with patch.object(selfie, "find_bodies", lambda *_: []):
            first, _ = selfie.segment(pixels)
        overlaps = [overlap(mask, true) for mask in (first > 127, posed > 0.5, found > 127)]
        rows.append((kind, len(people), len(split_people(found, bodies)), *overlaps))
        judged.append((overlaps[-1] < RIGHT or rows[-1][1] != rows[-1][2], bool(mask_doubts(found, bodies))))
    print("| pictures | number | selfie network | pose network | both | people right |\n|---|---|---|---|---|---|")
    for name in ("all", *KINDS):
        chosen = [row for row in rows if name in ("all", row[0])]
        columns = [np.array(column) for column in list(zip(*chosen))[3:]]
        cells = [f"{column.mean():.3f}, {column.min():.3f}, {(column < 0.9).mean():.0%}" for column in columns]
        right = np.mean([count == found for _, count, found, *_ in chosen])
        print(f"| {name} | {len(chosen)} | {' | '.join(cells)} | {right:.0%} |")
    wrong, doubtful = np.array(judged).T
    print(
        f"{wrong.sum()} wrong, {(wrong & doubtful).sum()} of them doubtful, and {(~wrong & doubtful).sum()} right ones"
    )
    print(f"{np.median(seconds):.2f} CPU-seconds each")


if __name__ == "__main__":
    main()
