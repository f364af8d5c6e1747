"""The files that `relight photo` writes: pictures, maps and light, in the photo's size and at its place."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.files import atomic_write
from relight.core.srgb import to_linear
from relight.lights import Light, lit_ball, write_light
from relight.maps import coefficient_names
from relight.maps.exr import write_exr
from relight.maps.square import Window, tiles
from relight.photos.guide import FittedMap, luma
from relight.photos.person import Person
from relight.photos.render import total_coverage
from relight.photos.scene import Scene
from relight.photos.shading import shade
from relight.photos.tone import display_shading
from relight.pictures.codes import on_white, to_srgb8
from relight.pictures.deep import write_deep
from relight.sh import mean_direction

STRIP_SIDE, GAP = 1080, 12  # pixels of the longer side of each picture in a strip, and between them
LAYERS = {"albedo": "RGB", "shading": "RGB", "normal": "XYZ"}  # of maps.exr, before the transport
RUNS = 3  # zlib's Z_RLE: a photo becomes as small as by its default, in a quarter of the time


def write_picture(path: Path, pixels: np.ndarray) -> None:
    """Writes (H,W) or (H,W,3|4): uint8, uint16 as PNG or TIFF, and float32 as OpenEXR, by the suffix."""
    if pixels.dtype != np.uint8:
        write_deep(path, pixels)
        return
    with atomic_write(path) as tmp:
        Image.fromarray(pixels).save(tmp, compress_type=RUNS)


def write_before_after(path: Path, before: np.ndarray, after: np.ndarray) -> None:
    """Writes a photo beside its relit version, as a JPEG to show.

    Args:
        path: .jpg.
        before: (H,W,3) or (H,W,4), uint8 or uint16 sRGB, or float32 linear; white where it is transparent.
        after: likewise.
    """
    codes = [Image.fromarray(on_white(pixels)) for pixels in (before, after)]
    codes = [image.reduce(-(-max(image.size) // STRIP_SIDE)) for image in codes]
    width, height = codes[0].size
    strip = Image.new("RGB", (2 * width + GAP, height), "white")
    for number, image in enumerate(codes):
        strip.paste(image, (number * (width + GAP), 0))
    with atomic_write(path) as tmp:
        strip.save(tmp, format="JPEG", quality=90)


def write_maps(folder: Path, scene: Scene) -> None:
    """Writes the inferred maps: to see, albedo.png and shading.png, transparent around the people; and maps.exr.

    The shading is scaled for display (color.display_shading). In maps.exr, which has `layers`, the display window is
    the picture, and the data window the part with people.
    """
    pixels, people = scene.picture.pixels, scene.people
    pictures = {name: np.zeros((*scene.picture.shape, 4), np.uint8) for name in ("albedo", "shading")}
    for picture in pictures.values():
        picture[..., 3] = total_coverage(people)
    for person in people:
        fits = person.fitted_albedo, person.fit_shading(person.light)
        for window, own, share, albedo, lit in placed_maps(person, people, pixels, fits):
            for name, codes in (("albedo", to_srgb8(albedo**2)), ("shading", to_srgb8(display_shading(lit)))):
                pictures[name][window][own, :3] += (share * codes).astype(np.uint8)
    for name, picture in pictures.items():
        write_picture(folder / f"{name}.png", picture)
    channels, top, left = layers(scene)
    windows = {"displayWindow": (0, 0, *scene.picture.shape), "dataWindow": (top, left, *channels["coverage.A"].shape)}
    header = {  # OpenEXR's windows hold the last pixel
        name: (np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32))
        for name, (y, x, height, width) in windows.items()
    }
    unoccluded = "mean unoccluded direction: the surface's normal where nothing is occluded"
    write_exr(folder / "maps.exr", channels, {**header, "normal": unoccluded})


def layers(scene: Scene) -> tuple[dict[str, np.ndarray], int, int]:
    """Returns the inferred maps at the picture's pixels, in the part of it that contains the people.

    Returns:
        Channels (h,w) float16 by name: `albedo.R/G/B`, `shading.R/G/B`, `normal.X/Y/Z`, `transport.L0M0.Y` ... and
        `coverage.A`; the first row and column of the part. The normals are the mean unoccluded directions
        (`relight.sh.mean_direction`), in the camera frame.
    """
    people = scene.people
    top, left = (min(person.crop.window[axis].start for person in people) for axis in (0, 1))
    bottom, right = (max(person.crop.window[axis].stop for person in people) for axis in (0, 1))
    names = [f"{layer}.{c}" for layer, axes in LAYERS.items() for c in axes]
    names += [f"transport.{name}.Y" for name in coefficient_names(scene.order)]
    channels = {name: np.zeros((bottom - top, right - left), np.float16) for name in names}
    channels["coverage.A"] = (total_coverage(people)[top:bottom, left:right] / np.float32(255)).astype(np.float16)
    for person in people:
        fits = person.fitted_albedo, person.fit(person.transport)
        for (rows, columns), own, share, albedo, transport in placed_maps(person, people, scene.picture.pixels, fits):
            window = slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)
            lit, normal = shade(transport, person.light), mean_direction(transport)
            values = share * np.concatenate([albedo**2, lit, normal, transport], -1)
            for name, channel in zip(names, values.T):
                channels[name][window][own] += channel
    return channels, top, left


def placed_maps(
    person: Person, people: Sequence[Person], pixels: np.ndarray, fits: tuple[FittedMap, FittedMap]
) -> Iterator[tuple[Window, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Yields two fitted maps of a person at the photo's pixels, in parts: those of an 8k photo are gigabytes.

    Args:
        person: whose maps they are.
        people: all in the photo.
        pixels: (H,W,3) of the photo.
        fits: a map that the colors guide, and one that the luma guides.

    Yields:
        The window of a part in the photo, its pixels of the person (h,w) bool, the person's share (N,1) of all people's
        coverage there, and the values (N,C) of both maps.
    """
    total = total_coverage(people)
    for window in tiles(person.crop.rows, person.crop.columns):
        own = person.coverage[window] > 0
        share = (person.coverage[window][own] / total[window][own]).astype(np.float32)[:, None]
        # The photo's detail beyond the network's resolution guides both maps.
        detail = person.detail(to_linear(pixels[window]), window)
        by_color, by_luma = fits[0].place(person.crop, detail, window), fits[1].place(person.crop, luma(detail), window)
        yield window, own, share, by_color[own], by_luma[own]


def write_light_files(stem: Path, coefficients: np.ndarray, source: str) -> None:
    """Writes a light (K,3) as `stem`.json, and `stem`.png, a matte ball that it lights."""
    light = Light(np.asarray(coefficients, np.float64), source)
    write_light(light, stem.with_name(f"{stem.name}.json"))
    ball = np.round(lit_ball(light.coefficients, 256) * 255).astype(np.uint8)
    write_picture(stem.with_name(f"{stem.name}.png"), ball)
