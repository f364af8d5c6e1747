"""The files that `relight photo` writes: pictures, maps and light, in the photo's size and at its place."""

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
from relight.photos.color import display_shading, to_srgb8
from relight.photos.deep import write_deep
from relight.photos.infer import Person
from relight.photos.render import strips, total_coverage
from relight.photos.shading import shading
from relight.photos.upsample import luma
from relight.sh import order_of
from relight.srgb import to_linear

RUNS = 3  # zlib's Z_RLE: a photo becomes as small as by its default, in a quarter of the time


def write_picture(path: Path, pixels: np.ndarray) -> None:
    """Writes (H,W) or (H,W,3|4): uint8 as PNG, uint16 as PNG or TIFF and float32 as OpenEXR, by the suffix."""
    if pixels.dtype != np.uint8:
        write_deep(path, pixels)
        return
    with atomic_write(path) as tmp:
        Image.fromarray(pixels).save(tmp, format="PNG", compress_type=RUNS)


def write_inference(folder: Path, people: Sequence[Person], pixels: np.ndarray) -> None:
    """Writes the inferred maps at the photo's resolution: albedo.png, shading.png and maps.exr.

    The PNGs are transparent around the people; the shading is scaled for display (color.display_shading). maps.exr has
    the channels `albedo.R/G/B`, `shading.R/G/B`, `transport.L0M0.Y` ... and `coverage.A` in half floats. Its display
    window is the photo, its data window the part that contains the people.

    Args:
        folder: of the files.
        people: as inferred.
        pixels: (H,W,3) of the photo.
    """
    height, width = people[0].coverage.shape
    top, left = (min(person.crop.window[axis].start for person in people) for axis in (0, 1))
    bottom, right = (max(person.crop.window[axis].stop for person in people) for axis in (0, 1))
    names = [f"albedo.{c}" for c in "RGB"] + [f"shading.{c}" for c in "RGB"]
    names += [f"transport.{name}.Y" for name in coefficient_names(order_of(people[0].transport.shape[2]))]
    channels = {name: np.zeros((bottom - top, right - left), np.float16) for name in names}
    pictures = {name: np.zeros((height, width, 4), np.uint8) for name in ("albedo", "shading")}
    for picture in pictures.values():
        picture[..., 3] = total_coverage(people)
    channels["coverage.A"] = (pictures["albedo"][top:bottom, left:right, 3] / np.float32(255)).astype(np.float16)
    for person in people:
        fits = person.fitted_albedo, person.fitted_transport
        columns = slice(*person.crop.columns)
        for rows in strips(*person.crop.rows):  # the maps of a person in an 8k photo are gigabytes
            own = person.coverage[slice(*rows), columns] > 0
            where = np.flatnonzero(own)
            detail = person.detail(to_linear(pixels[slice(*rows), columns][own]), rows, where)
            albedo, transport = (
                fit.place(person.crop, guide, rows, where) for fit, guide in zip(fits, (detail, luma(detail)))
            )
            albedo = albedo**2
            lit = shading(transport, person.light)
            for name, codes in (("albedo", to_srgb8(albedo)), ("shading", to_srgb8(display_shading(lit)))):
                pictures[name][slice(*rows), columns, :3][own] = codes
            window = slice(rows[0] - top, rows[1] - top), slice(columns.start - left, columns.stop - left)
            for name, values in zip(names, np.concatenate([albedo, lit, transport], -1).T):
                channels[name][window][own] = values
    for name, picture in pictures.items():
        write_picture(folder / f"{name}.png", picture)
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


def write_light_files(stem: Path, coefficients: np.ndarray, source: str) -> None:
    """Writes a light (K,3) as `stem`.json and `stem`.relight.npy, and `stem`.png, a matte ball that it lights."""
    light = Light(np.asarray(coefficients, np.float64), source)
    write_light(light, stem.with_name(f"{stem.name}.json"))
    write_light(light, stem.with_name(f"{stem.name}.npy"))
    ball = np.round(lit_ball(light.coefficients, 256) * 255).astype(np.uint8)
    write_picture(stem.with_name(f"{stem.name}.png"), ball)


def write_json(path: Path, record: dict) -> None:
    """Writes a record of JSON values."""
    with atomic_write(path) as tmp:
        tmp.write_text(json.dumps(record, indent=1) + "\n")


def _window(left: int, top: int, right: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([right - 1, bottom - 1], np.int32)
