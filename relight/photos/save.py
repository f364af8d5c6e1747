"""What `relight photo` leaves in its folder: pictures, maps and light, all at the photo's own size and place."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from relight import __version__
from relight.files import atomic_write
from relight.lights import Light, lit_ball, write_light
from relight.maps import coefficient_names
from relight.maps.exr import CONVENTION, FRAME
from relight.photos.color import shown, to_srgb8
from relight.photos.composite import strips
from relight.photos.infer import Figure
from relight.photos.relight import shading
from relight.photos.render import coverage_of
from relight.photos.upsample import luma
from relight.sh import order_of
from relight.srgb import LINEAR


def save_picture(path: Path, pixels: np.ndarray) -> None:
    """(H,W) or (H,W,3|4) uint8 as a PNG; fast rather than small for pictures of more than a megapixel."""
    with atomic_write(path) as tmp:
        Image.fromarray(pixels).save(
            tmp, format="PNG", compress_level=6 if pixels.shape[0] * pixels.shape[1] < 1e6 else 1
        )


def save_inference(folder: Path, figures: Sequence[Figure], pixels: np.ndarray) -> None:
    """albedo.png, shading.png (both transparent around the figures) and maps.exr, all as fine as the photo `pixels`.

    shading.png is at a display scale of its own (relight.photos.color.shown). maps.exr is one OpenEXR: `albedo.R/G/B`,
    `shading.R/G/B`, `transport.L0M0.Y` ... and `coverage.A`, half floats. Its display window is the photo, its data
    window the part of it that holds the figures, as film tools expect.
    """
    height, width = figures[0].coverage.shape
    top, left = (min(f.frame.window[axis].start for f in figures) for axis in (0, 1))
    bottom, right = (max(f.frame.window[axis].stop for f in figures) for axis in (0, 1))
    names = [f"albedo.{c}" for c in "RGB"] + [f"shading.{c}" for c in "RGB"]
    names += [f"transport.{name}.Y" for name in coefficient_names(order_of(figures[0].transport.shape[2]))]
    channels = {name: np.zeros((bottom - top, right - left), np.float16) for name in names}
    pictures = {name: np.zeros((height, width, 4), np.uint8) for name in ("albedo", "shading")}
    for picture in pictures.values():
        picture[..., 3] = coverage_of(figures)
    channels["coverage.A"] = (pictures["albedo"][top:bottom, left:right, 3] / np.float32(255)).astype(np.float16)
    for figure in figures:
        fits = figure.fitted_albedo, figure.fitted_transport
        columns = slice(*figure.frame.columns)
        for rows in strips(*figure.frame.rows):  # all of an 8k figure's maps at once would be gigabytes
            mine = figure.coverage[slice(*rows), columns] > 0
            detail = figure.detail(LINEAR[pixels[slice(*rows), columns]], rows)[mine]
            albedo, transport = (
                fit.place(figure.frame, guide, rows, np.flatnonzero(mine))
                for fit, guide in zip(fits, (detail, luma(detail)))
            )
            albedo = albedo**2
            lit = shading(transport, figure.light)
            for name, codes in (("albedo", to_srgb8(albedo)), ("shading", to_srgb8(shown(lit)))):
                pictures[name][slice(*rows), columns, :3][mine] = codes
            window = slice(rows[0] - top, rows[1] - top), slice(columns.start - left, columns.stop - left)
            for name, values in zip(names, np.concatenate([albedo, lit, transport], -1).T):
                channels[name][window][mine] = values
    for name, picture in pictures.items():
        save_picture(folder / f"{name}.png", picture)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "displayWindow": _window(0, 0, width, height),
        "dataWindow": _window(left, top, right, bottom),
        "software": f"relight {__version__}",
        "frame": FRAME,
        "convention": CONVENTION,
    }
    with atomic_write(folder / "maps.exr") as tmp:
        OpenEXR.File(header, channels).write(str(tmp))


def save_light(stem: Path, coefficients: np.ndarray, source: str) -> None:
    """`stem`.json and `stem`.relight.npy, each with its convention, and `stem`.png, the matt ball that it lights."""
    light = Light(np.asarray(coefficients, np.float64), source)
    write_light(light, stem.with_name(f"{stem.name}.json"))
    write_light(light, stem.with_name(f"{stem.name}.npy"))
    save_picture(stem.with_name(f"{stem.name}.png"), np.round(lit_ball(light.coefficients, 256) * 255).astype(np.uint8))


def save_json(path: Path, record: dict) -> None:
    with atomic_write(path) as tmp:
        tmp.write_text(json.dumps(record, indent=1) + "\n")


def _window(left: int, top: int, right: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([right - 1, bottom - 1], np.int32)
