"""Draws docs/images/benchmark.jpg: photos of a benchmark, relit by a method in two ways, and the truth.

python tools/benchmark.py SET ANSWERS [--out FILE.jpg]

The pictures are evenly spaced by rank of `full: RMSE`, from the best on the left to the worst; each in its first new
light.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from relight.benchmark.files import BenchmarkSet, read_arrays
from relight.benchmark.score import read_scores
from relight.config import ROOT

COUNT, SIDE, PAPER = 6, 200, 242


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images" / "benchmark.jpg")
    args = parser.parse_args()
    benchmark = BenchmarkSet(args.truth)
    entries = [entry for entry in benchmark.entries if not entry.of]
    order = np.argsort(read_scores(args.answers)["full"])
    columns = []
    for rank in np.linspace(0, len(entries) - 1, COUNT).round().astype(int):
        entry = entries[order[rank]]
        answer, shot = read_arrays(args.answers / f"{entry.name}.npz"), entry.shot()
        pictures = [answer["ratio"][0], answer["full"][0], benchmark.truth(entry)[1][0]]
        inside = shot.mask[..., None] / 255
        on_paper = [np.uint8(one * inside + PAPER * (1 - inside) + 0.5) for one in pictures]
        top, left, side = (round(value) for value in (shot.square.top, shot.square.left, shot.square.side))
        tiles = [Image.new("RGB", (side, side), (PAPER,) * 3) for _ in range(4)]
        for tile, pixels in zip(tiles, (shot.photo, *on_paper)):
            tile.paste(Image.fromarray(pixels), (-left, -top))
        columns.append(
            np.concatenate([np.asarray(one.resize((SIDE, SIDE), Image.Resampling.LANCZOS)) for one in tiles])
        )
    Image.fromarray(np.concatenate(columns, 1)).save(args.out, quality=88, optimize=True)


if __name__ == "__main__":
    main()
