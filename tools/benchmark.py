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

COUNT = 6  # pictures
SIDE = 200  # pixels of a tile
PAPER = 242  # code of the background


def main() -> None:
    """Draws a column for each picture: the photo, relit by ratio, rendered from maps, and the truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images" / "benchmark.jpg")
    args = parser.parse_args()
    benchmark = BenchmarkSet(args.truth)
    entries = [entry for entry in benchmark.entries if not entry.of]
    order = np.argsort(read_scores(args.answers)["full"].to_numpy())
    columns = []
    for rank in np.linspace(0, len(entries) - 1, COUNT).round().astype(int):
        entry = entries[order[rank]]
        answer, shot = read_arrays(args.answers / f"{entry.name}.npz"), entry.shot()
        _, true_pictures = benchmark.truth(entry)
        relit = [answer["ratio"][0], answer["full"][0], true_pictures[0]]
        coverage = shot.mask[..., None] / 255
        on_paper = [np.uint8(picture * coverage + PAPER * (1 - coverage) + 0.5) for picture in relit]  # rounded
        top, left, side = (round(value) for value in (shot.square.top, shot.square.left, shot.square.side))
        tiles = []
        for pixels in (shot.photo, *on_paper):
            tile = Image.new("RGB", (side, side), (PAPER,) * 3)
            tile.paste(Image.fromarray(pixels), (-left, -top))
            tiles.append(np.asarray(tile.resize((SIDE, SIDE), Image.Resampling.LANCZOS)))
        columns.append(np.concatenate(tiles))
    Image.fromarray(np.concatenate(columns, axis=1)).save(args.out, quality=88, optimize=True)


if __name__ == "__main__":
    main()
