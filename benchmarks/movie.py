"""Measures the CPU-seconds per frame of `relight movie` with a rotating light, also against another checkout.

    python benchmarks/movie.py [--photo me.jpg --mask me_mask.png] [--against FOLDER]

By default the photo is the portrait of docs/photos.md, at 720 x 940. Processes of the two checkouts alternate, so that
other load affects both. Each infers the photo once and renders its frames, of which the median is reported. The last
frames of the two are compared.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
BACKGROUNDS = ("keep", "#808890", "panorama")
SIZE = 720, 940


def time_frames(photo: Path | None, mask: Path | None, frames: int, last_frames: Path) -> dict[str, float]:
    """Measures the frames of a movie of a photo, and saves the last frame for each background.

    Args:
        photo: file; None for a portrait that scikit-image has.
        mask: of the photo.
        frames: number of frames to time; the first is left out.
        last_frames: .npz to write.

    Returns:
        The median CPU-seconds of a frame, by background.
    """
    import time

    import torch
    from PIL import Image

    from relight.photos.api import load, match_exposure
    from relight.photos.load import load_photo
    from relight.photos.movie import turn_light
    from relight.photos.photo import Options
    from relight.photos.read import read_mask, read_photo

    torch.set_num_threads(1)
    relighter = load()
    if photo is None:
        from skimage import data

        from relight.viewer.source import PORTRAIT_MASK

        mask = PORTRAIT_MASK
        pixels = np.asarray(Image.fromarray(data.astronaut()).resize(SIZE, Image.Resampling.BICUBIC))
        coverage = np.asarray(Image.open(mask).convert("L").resize(SIZE, Image.Resampling.BICUBIC))
    else:
        pixels = read_photo(photo).pixels
        coverage = read_mask(mask, pixels.shape[:2])
    loaded = load_photo(pixels, coverage).downscaled(max(SIZE))
    pixels, people = loaded.pixels, relighter.infer(loaded)
    seconds, last = {}, {}
    for name in BACKGROUNDS:
        options = Options(light="room:7", background=name)
        light = relighter.read_light(options.light)
        matched, background = match_exposure(people, light.coefficients, options.read_background(light))
        stream = turn_light(pixels, people, matched, options, background, frames)
        times = []
        for _ in range(frames):
            start = time.process_time()
            last[name] = next(stream)
            times.append(time.process_time() - start)
        seconds[name] = float(np.median(times[1:]))
    np.savez(last_frames, **last)
    return seconds


def run_checkout(checkout: Path, words: list[str], last_frames: Path) -> dict[str, float]:
    """Runs `time_frames` in a process with the package of another checkout.

    Args:
        checkout: folder of the package.
        words: arguments of this program.
        last_frames: .npz to write.

    Returns:
        The median CPU-seconds of a frame, by background.
    """
    environment = os.environ | {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, *words, "--child", str(last_frames)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{checkout}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Prints the CPU-seconds of a frame by background, of this checkout and another."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photo", type=Path)
    parser.add_argument("--mask", type=Path)
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--against", type=Path, help="The folder of another checkout of relight.")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        print(json.dumps(time_frames(args.photo, args.mask, args.frames, args.child)))
        return
    words = ["--frames", str(args.frames)]
    words += ["--photo", str(args.photo), "--mask", str(args.mask)] if args.photo else []
    checkouts = [*([args.against.resolve()] if args.against else []), ROOT]
    found = {checkout: [] for checkout in checkouts}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(args.pairs):
            for number, checkout in enumerate(checkouts):
                found[checkout].append(run_checkout(checkout, words, Path(folder) / f"{number}.npz"))
        pictures = [np.load(Path(folder) / f"{number}.npz") for number in range(len(checkouts))]
        print(
            "| background | "
            + " | ".join(map(str, checkouts))
            + " | largest difference |\n|---|"
            + "---|" * len(found)
            + "---|"
        )
        for name in BACKGROUNDS:
            values = [f"{np.median([each[name] for each in runs]):.3f}" for runs in found.values()]
            difference = max(int(np.abs(each[name].astype(int) - pictures[-1][name]).max()) for each in pictures)
            print(f"| {name} | " + " | ".join(values) + f" | {difference} |")


if __name__ == "__main__":
    main()
