"""Imports captures of real people as a set of the benchmark."""

import zlib
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from relight.benchmark.lights import panorama
from relight.benchmark.make import FORMAT, check_plan, save_picture, write_index
from relight.benchmark.picture import BRIGHTNESS, MIN_ALBEDO, Picture, on_square
from relight.benchmark.recipes import draw_recipe
from relight.benchmark.shots import Shot, variants
from relight.captures.capture import Capture, list_captures, read_capture
from relight.captures.maps import measure_maps, to_image
from relight.files import writable_folder
from relight.maps.square import MASK_THRESHOLD, crop_around
from relight.panoramas import Panorama, project
from relight.panoramas.lookup import lookup
from relight.panoramas.projection import latlong_directions
from relight.panoramas.radiosity import HEIGHT, WIDTH
from relight.photos.camera import camera_view
from relight.srgb import encode, to_bytes

SET = "captures"
SQUARE_SIZE = 256  # pixels, of the square on which maps are compared
FIRST_SEED = 10_000_000  # of the lights; above the seeds of all other sets
BLUR = 0.6  # standard deviation over the lamps' spacing: an even light has ripples of 6 exp(-2 pi^2 BLUR^2), 0.5 %
UPSAMPLING = 4  # of panoramas along each axis, before the nearest texel is taken


def import_captures(source: Path | str, folder: Path | str, only: str = "") -> str:
    """Imports captures into a set, resuming where it was stopped.

    Args:
        source: folder of the captures (`relight.captures.capture`).
        folder: folder of the benchmark's set.
        only: a regular expression that names of captures must match anywhere; by default all do.

    Returns:
        The set's hash.

    Raises:
        UserError: for another set in the folder, or files that are missing or broken.
    """
    folder, settings = writable_folder(folder, "--out"), {"size": 2 * SQUARE_SIZE}
    captures = list_captures(source, only)
    check_plan(folder, {"format": FORMAT, "set": SET, "settings": settings, "only": only})
    subjects: set[str] = set()
    for name, path in captures.items():
        capture = read_capture(path)
        if not (folder / "inputs" / name).is_dir():
            record, picture = import_capture(capture, with_variants=capture.subject not in subjects)
            save_picture(folder, name, capture.subject, record, picture)
        subjects.add(capture.subject)
    return write_index(folder, SET, list(captures), settings, scale="unknown")


def import_capture(capture: Capture, with_variants: bool) -> tuple[dict, Picture]:
    """Renders a capture in one panorama and four new ones as sums of its frames, and measures the ground truth.

    Args:
        capture: capture of a light stage.
        with_variants: the first picture of each person has variants.

    Returns:
        How the picture was made, for picture.json, and the picture.
    """
    mask, inside = capture.mask, capture.mask >= MASK_THRESHOLD
    square = crop_around(mask, SQUARE_SIZE)
    recipe = draw_recipe(FIRST_SEED + zlib.crc32(capture.name.encode()) % FIRST_SEED, number=1)
    brightness = BRIGHTNESS * 2**recipe.stops
    sharp = [panorama(light, pitch=0.0, brightness=brightness).pixels for light in (recipe.light, *recipe.new)]
    lights = blur_to_spacing(np.stack(sharp), len(capture.lamps)).astype(np.float32)
    measured, maps, scale = measure_maps(capture, UpsampledPanoramas(lights).radiance)
    linear, *relit = np.moveaxis(to_image(measured.pictures / scale, inside), 2, 0)
    light, *new = (Panorama(light, source=f"{recipe.name}.{i}") for i, light in enumerate(lights))
    scene = linear + (1 - maps.coverage[..., None]) * np.pi * camera_view(light, mask.shape)

    def expose(gain: np.ndarray | float) -> np.ndarray:
        """Returns the photograph (H,W,3) uint8 at a gain, a number or (3,)."""
        return to_bytes(encode(scene * gain))

    shots = variants(expose, mask, SQUARE_SIZE) if with_variants else {"": Shot(expose(gain=1.0), mask, square)}
    shading = linear / np.maximum(maps.albedo, MIN_ALBEDO) * inside[..., None]
    truth = on_square(maps, shading, project(light, order=2), square)
    picture = Picture(shots, light, new, maps, np.stack([to_bytes(encode(image)) for image in relit]), truth)
    return {**asdict(recipe), "name": capture.name, **maps.info["measured"]}, picture


class UpsampledPanoramas:
    """Panoramas, upsampled so far that a lookup can take the nearest texel.

    Attributes:
        count: N, the number of panoramas.
        texels: (UPSAMPLING * HEIGHT, UPSAMPLING * WIDTH, 3 N) float32.
    """

    def __init__(self, panoramas: Iterable[np.ndarray]):
        """Takes lat-long panoramas (HEIGHT,WIDTH,3): -z is at their centre, and +x to the right."""
        height, width = UPSAMPLING * HEIGHT, UPSAMPLING * WIDTH
        axes = latlong_directions(height, width)
        layers = [lookup(Panorama(pixels), axes) for pixels in panoramas]
        self.count = len(layers)
        self.texels = np.concatenate(layers, -1)

    def radiance(self, directions: np.ndarray) -> np.ndarray:
        """Returns the radiance (P,N,3) in directions (P,3)."""
        height, width = self.texels.shape[:2]
        x, y, z = directions.T
        row = np.minimum((np.arccos(np.clip(y, -1, 1)) / np.pi * height).astype(int), height - 1)
        column = ((np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width).astype(int) % width
        return self.texels[row, column].reshape(len(directions), self.count, 3)


def blur_to_spacing(panoramas: np.ndarray, lamps: int) -> np.ndarray:
    """Returns panoramas (...,64,128,3) blurred to the resolution that a stage with so many lamps can show.

    Each texel becomes the mean about it with a von Mises-Fisher kernel, whose standard deviation is BLUR times the
    distance between lamps. Along the rows this is a convolution, computed as a product of Fourier coefficients.

    Args:
        panoramas: lat-long.
        lamps: their number.
    """
    theta = (np.arange(HEIGHT) + 0.5) / HEIGHT * np.pi
    azimuth = np.arange(WIDTH) / WIDTH * 2 * np.pi
    sine, cosine = np.sin(theta), np.cos(theta)
    # Cosine of the angle between texels, by the row of each and the difference of their azimuths.
    between = np.outer(cosine, cosine)[..., None] + np.outer(sine, sine)[..., None] * np.cos(azimuth)
    variance = BLUR**2 * 4 * np.pi / lamps  # a lamp has 4 pi / lamps steradians, the square of the distance
    kernel = np.exp((between - 1) / variance) * sine[:, None]  # sine: proportional to a texel's solid angle
    kernel /= kernel.sum((1, 2), keepdims=True)
    spectrum = np.einsum("ijf,...jfc->...ifc", np.fft.rfft(kernel), np.fft.rfft(panoramas, axis=-2), optimize=True)
    return np.fft.irfft(spectrum, WIDTH, axis=-2)
