"""What `relight photo` leaves in its folder: pictures, maps and light, all at the photo's own size and place."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from relight import __version__
from relight.files import whole
from relight.lights.light import Light
from relight.lights.show import ball
from relight.lights.store import write_light
from relight.maps.exr import CONVENTION, FRAME, coefficient_names
from relight.photos.color import develop, to_srgb8
from relight.photos.composite import strips
from relight.photos.infer import Figure
from relight.photos.render import coverage_of
from relight.sh.basis import order_of


def save_picture(path: Path, pixels: np.ndarray) -> None:
    """(H,W,3|4) uint8 as a PNG; fast rather than small for pictures of many megapixels."""
    with whole(path) as tmp:
        Image.fromarray(pixels).save(tmp, format="PNG", compress_level=6 if pixels.size < 2e7 else 1)


def save_inference(folder: Path, figures: Sequence[Figure]) -> None:
    """albedo.png, shading.png (transparent around the figures) and maps.exr."""
    coverage = coverage_of(figures)
    save_picture(folder / "albedo.png", _spread(figures, [f.full_albedo() for f in figures], coverage, to_srgb8))
    save_picture(folder / "shading.png", _spread(figures, [f.extended(f.shading) for f in figures], coverage, develop))
    save_maps(folder / "maps.exr", figures)


def save_maps(path: Path, figures: Sequence[Figure]) -> None:
    """One OpenEXR: `albedo.R/G/B`, `shading.R/G/B`, `transport.L0M0.Y` ... and `coverage.A`, half floats.

    The display window is the photo, the data window the part of it that holds the figures, as film tools expect.
    """
    height, width = figures[0].coverage.shape
    top, left = (min(f.frame.window[axis].start for f in figures) for axis in (0, 1))
    bottom, right = (max(f.frame.window[axis].stop for f in figures) for axis in (0, 1))
    names = [f"albedo.{c}" for c in "RGB"] + [f"shading.{c}" for c in "RGB"]
    names += [f"transport.{name}.Y" for name in coefficient_names(order_of(figures[0].transport.shape[2]))]
    channels = {name: np.zeros((bottom - top, right - left), np.float16) for name in [*names, "coverage.A"]}
    for figure in figures:
        rows, columns = figure.frame.window
        window = slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)
        mine = figure.coverage[figure.frame.window] > 0
        maps = [figure.full_albedo(), figure.extended(figure.shading), figure.extended(figure.transport)]
        for name, values in zip(names, np.moveaxis(np.concatenate(maps, -1), -1, 0)):
            # one channel at a time: all of an 8k figure's at once would be gigabytes
            np.copyto(channels[name][window], figure.frame.place(values), where=mine, casting="same_kind")
        alpha = figure.coverage[figure.frame.window] / np.float32(255)
        np.copyto(channels["coverage.A"][window], alpha, where=mine, casting="same_kind")
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "displayWindow": _window(0, 0, width, height),
        "dataWindow": _window(left, top, right, bottom),
        "software": f"relight {__version__}",
        "frame": FRAME,
        "convention": CONVENTION,
    }
    with whole(path) as tmp:
        OpenEXR.File(header, channels).write(str(tmp))


def save_light(stem: Path, coefficients: np.ndarray, source: str) -> None:
    """`stem`.json and `stem`.relight.npy, each with its convention, and `stem`.png, the matt ball that it lights."""
    light = Light(np.asarray(coefficients, np.float64), source)
    write_light(light, stem.with_name(f"{stem.name}.json"))
    write_light(light, stem.with_name(f"{stem.name}.npy"))
    save_picture(stem.with_name(f"{stem.name}.png"), np.round(ball(light.coefficients, 256) * 255).astype(np.uint8))


def save_json(path: Path, record: dict) -> None:
    with whole(path) as tmp:
        tmp.write_text(json.dumps(record, indent=1) + "\n")


def _spread(figures: Sequence[Figure], maps: Sequence[np.ndarray], coverage: np.ndarray, code) -> np.ndarray:
    """Maps (S,S,3) of each figure at their place in the photo, as (H,W,4) uint8 with the coverage as alpha."""
    out = np.zeros((*coverage.shape, 4), np.uint8)
    out[..., 3] = coverage
    for figure, values in zip(figures, maps):
        columns = slice(*figure.frame.columns)
        for first, last in strips(*figure.frame.rows):
            mine = figure.coverage[first:last, columns, None] > 0
            np.copyto(out[first:last, columns, :3], code(figure.frame.place(values, (first, last))), where=mine)
    return out


def _window(left: int, top: int, right: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([right - 1, bottom - 1], np.int32)
