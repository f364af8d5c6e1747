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
    """Measures the frames of a photo whose light rotates.

    Args:
        photo, mask: files; None for the portrait of docs/photos.md.
        frames: number of frames, of which the first is not counted.
        last_frames: the .npz to which the last frame is saved, by background.

    Returns:
        Background -> median CPU-seconds per frame.
    """
    import time

    import torch
    from PIL import Image

    from relight.photos.api import load
    from relight.photos.look import Look
    from relight.photos.mask.find import read_mask
    from relight.photos.picture import Picture

    torch.set_num_threads(1)
    relighter = load()
    if photo is None:
        from skimage import data

        from relight.viewer.source import PORTRAIT_MASK

        mask = PORTRAIT_MASK
        pixels = np.asarray(Image.fromarray(data.astronaut()).resize(SIZE, Image.Resampling.BICUBIC))
        coverage = np.asarray(Image.open(mask).convert("L").resize(SIZE, Image.Resampling.BICUBIC))
    else:
        pixels = Picture.of(photo).pixels
        coverage, _ = read_mask(mask, pixels.shape[:2])
    scene = relighter.scene(pixels, coverage, max(SIZE))
    seconds, last = {}, {}
    for name in BACKGROUNDS:
        look = Look("room:7", background=name)
        stream = scene.turned(look, *scene.exposed(look), list(2 * np.pi * np.arange(frames) / frames))
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
        checkout: folder of the repository.
        words: options of this script.
        last_frames: the .npz to which the last frames are saved.
    """
    environment = os.environ | {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, *words, "--child", str(last_frames)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{checkout}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Prints a row for each background: CPU-seconds per frame, and the largest difference of codes."""
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
    seconds = {checkout: [] for checkout in checkouts}  # those of each process, by background
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(args.pairs):
            for number, checkout in enumerate(checkouts):
                seconds[checkout].append(run_checkout(checkout, words, Path(folder) / f"{number}.npz"))
        pictures = [np.load(Path(folder) / f"{number}.npz") for number in range(len(checkouts))]
        print(f"| background | {' | '.join(map(str, checkouts))} | largest difference |")
        print("|---|" + "---|" * len(checkouts) + "---|")
        for name in BACKGROUNDS:
            values = [f"{np.median([run[name] for run in runs]):.3f}" for runs in seconds.values()]
            difference = max(int(np.abs(frames[name].astype(int) - pictures[-1][name]).max()) for frames in pictures)
            print(f"| {name} | " + " | ".join(values) + f" | {difference} |")


if __name__ == "__main__":
    main()
