"""Brings captures of real people into the benchmark's format, so that anyone's answers to them can be scored."""

import csv
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from relight.benchmark import humanolat, ultrastage
from relight.benchmark.bakedstage import agreement, bake_as_seen
from relight.benchmark.lights import panorama
from relight.benchmark.lightstage import Lighting, Stage, coarse, measure
from relight.benchmark.make import FORMAT, index, same, save
from relight.benchmark.measures import Seen
from relight.benchmark.picture import BRIGHTNESS, DARKEST, Picture, on_square
from relight.benchmark.recipes import recipe
from relight.benchmark.shots import Shot, variants
from relight.files import UserError, atomic_write, read_table, writable_folder
from relight.maps import Maps
from relight.meshes import read_mesh
from relight.panoramas import Panorama, project
from relight.panoramas.radiosity import view_directions
from relight.photos.crop import MASK_THRESHOLD, crop_around, fill_outside
from relight.photos.environment import camera_view
from relight.progress import progress
from relight.sh import UNOCCLUDED_T00
from relight.srgb import LINEAR, encode, to_bytes

SIDE = 256  # pixels of the square on which maps are compared
FIRST = 10_000_000  # seeds of the lights, above those of all other sets
WHITEST = 0.9  # what the brightest hundredth of a person's albedo is taken for, since no frame tells
KNOWN = 0.5  # of a person's pixels must be lit by enough frames
BAKED = "baked.csv"


@dataclass(frozen=True)
class Taken:
    """A picture of a set, what it was made from, and how its measured transport agrees with a baked one, if any."""

    picture: Picture
    record: dict
    agreement: dict[str, float] | None = None


Source = Iterator[tuple[str, str, Callable[[bool], Taken]]]  # name, figure, and what takes the picture


def bring(layout: str, source: Path | str, folder: Path | str, only: str = "", rays: int = 256) -> str:
    """Brings captures into a set; goes on where it was stopped.

    Args:
        layout: a key of LAYOUTS.
        source: folder of the data set as published.
        folder: of the set.
        only: a regular expression that the names of captures match anywhere; all by default.
        rays: of a pixel, for baking the captures' meshes.

    Returns:
        The set's hash.

    Raises:
        UserError: for another layout, another set in the folder, and files that are missing or broken.
    """
    if layout not in LAYOUTS:
        raise UserError(f"layout {layout}: {' or '.join(LAYOUTS)}")
    folder, settings = writable_folder(folder, "--out"), {"size": 2 * SIDE, "rays": rays}
    names, figures = [], set()
    for name, figure, take in LAYOUTS[layout](Path(source), only, rays):
        if not names:
            same(folder, {"format": FORMAT, "set": layout, "settings": settings})
        varied = figure not in figures  # one picture of each person is there in variants
        names.append(name)
        figures.add(figure)
        if not (folder / "inputs" / name).is_dir():
            taken = take(varied)
            if taken.agreement:
                tell(folder / BAKED, name, taken.agreement)
            save(folder, name, figure, taken.record, taken.picture)
    return index(folder, layout, names, settings, scale="unknown")


def tell(path: Path, name: str, row: dict[str, float]) -> None:
    """Adds the row of a picture to a table, or replaces it."""
    rows = {one["picture"]: one for one in read_table(path)[1]} if path.is_file() else {}
    rows[name] = {"picture": name, **{key: f"{value:.6g}" for key, value in row.items()}}
    with atomic_write(path) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[name]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[one] for one in sorted(rows))


def one_light_frames(source: Path, only: str, rays: int) -> Source:
    """The captures of HumanOLAT: `relight.benchmark.humanolat`."""
    for capture in humanolat.captures(source, only):
        yield capture.name, capture.subject, lambda varied, capture=capture: photographed(capture, rays, varied)


def photographed(capture: humanolat.Capture, rays: int, varied: bool) -> Taken:
    """Photographs a capture in a panorama and four new ones, as sums of its frames; the truth is what they measure.

    Where its mesh is there, it tells how far each pixel's surface is, and is baked; without, all of the person is taken
    to be in the plane through the stage's centre that faces the camera. Pixels that too few lamps light take albedo and
    transport from the nearest others.
    """
    mask, camera = capture.read_mask(), capture.camera
    inside = mask >= MASK_THRESHOLD
    square = crop_around(mask, SIDE)
    capture.check_order(inside)
    stage = Stage.of((capture.lamps - camera.eye) @ camera.rotation.T)
    drawn = recipe(FIRST + zlib.crc32(capture.name.encode()) % FIRST, 1)
    brightness = BRIGHTNESS * 2**drawn.stops
    lights = coarse(
        np.stack([panorama(one, 0.0, brightness).pixels for one in (drawn.light, *drawn.new)]), len(capture.lamps)
    ).astype(np.float32)
    baked = None
    depth = np.full(mask.shape, -stage.centre[2])
    if capture.model:
        baked = bake_as_seen(read_mesh(capture.model), camera, inside, stage, rays)
        if not baked.hit.any():
            raise UserError(f"{capture.model} is not in the picture of {capture.name}: it must be in millimetres")
        shown, found = np.zeros(mask.shape, bool), np.zeros(mask.shape)
        shown[inside], found[inside] = baked.hit, baked.depth
        depth = fill_outside(found, shown)
    row, column = np.nonzero(inside)
    rays_out = camera.rays(column + 0.5, row + 0.5)[:, 3:] @ camera.rotation.T
    points = rays_out * depth[inside][:, None]

    def frames():
        return progress(capture.read_frames(inside), f"frames of {capture.name}", len(capture.frames))

    measured = measure(frames, stage, points, Lighting(lights))
    if measured.known.mean() < KNOWN:
        raise UserError(
            f"{capture.name}: its frames light {measured.known.mean():.0%} of the person enough, {KNOWN:.0%} are needed"
        )
    scale = float(np.quantile(measured.albedo[measured.known].max(1), 0.99)) / WHITEST
    told = np.zeros(mask.shape, bool)
    told[inside] = measured.known

    def image(values: np.ndarray) -> np.ndarray:
        whole = np.zeros((*mask.shape, *values.shape[1:]), np.float32)
        whole[inside] = values
        return whole

    def filled(values: np.ndarray) -> np.ndarray:
        whole = fill_outside(image(values), told)
        whole[~inside] = 0
        return whole

    coverage = mask / np.float32(255)
    light, *new = (Panorama(one, source=f"{drawn.name}.{i}") for i, one in enumerate(lights))
    linear, *relit = np.moveaxis(image(measured.pictures / scale), 2, 0)
    transport = filled(measured.transport)
    facts = {
        "lamps": len(capture.lamps), "absent": capture.absent, "known": round(float(measured.known.mean()), 4),
        "clipped": round(measured.clipped, 6), "stage_error": round(stage.error, 6),
    }  # fmt: skip
    maps = Maps(
        mask=inside,
        coverage=coverage,
        albedo=filled(measured.albedo / scale),
        normal=filled(measured.normal),
        depth=(depth * inside).astype(np.float32),
        ao=(transport[..., 0] / np.float32(UNOCCLUDED_T00)).clip(0, 1),
        transport=transport,
        info={"name": capture.name, "subject": capture.subject, "measured": facts},
    )
    shading = linear / np.maximum(maps.albedo, DARKEST) * inside[..., None]
    scene = linear + (1 - coverage[..., None]) * np.pi * camera_view(light, mask.shape)

    def expose(gain: np.ndarray | float) -> np.ndarray:
        return to_bytes(encode(scene * gain))

    shots = variants(expose, mask, SIDE) if varied else {"": Shot(expose(1.0), mask, square)}
    seen = on_square(maps, shading, project(light, 2), square)
    picture = Picture(shots, light, new, maps, np.stack([to_bytes(encode(one)) for one in relit]), seen)
    compared = agreement(measured, baked, inside) if baked else None
    return Taken(picture, {**asdict(drawn), "name": capture.name, **facts}, compared)


def gradient_frames(source: Path, only: str, rays: int) -> Source:
    """The captures of UltraStage: `relight.benchmark.ultrastage`."""
    for capture in ultrastage.captures(source, only):
        yield capture.name, capture.figure, lambda varied, capture=capture: gradients(capture, varied)


def gradients(capture: ultrastage.Capture, varied: bool) -> Taken:
    """The picture under all lamps, and as new lights the two gradients, whose pictures are there.

    The light of the photograph is even: radiance 1 from everywhere, but for brightness. Neither albedo nor transport is
    known.
    """
    found = ultrastage.read(capture)
    square = crop_around(found.mask, SIDE)
    even = np.full((64, 128, 3), BRIGHTNESS / np.pi, np.float32)
    directions = view_directions().reshape(64, 128, 3)
    slope = directions @ (capture.rotation @ found.gradients.T)  # of each channel
    light = Panorama(even, source="full on")
    new = [Panorama((even * found.level * (1 + sign * slope) / 2).astype(np.float32)) for sign in (1, -1)]
    linear = LINEAR[found.full_on]
    inside = found.mask >= MASK_THRESHOLD

    def expose(gain: np.ndarray | float) -> np.ndarray:
        return to_bytes(encode(linear * gain))

    shots = variants(expose, found.mask, SIDE) if varied else {"": Shot(found.full_on, found.mask, square)}
    seen = Seen(square.extract(found.mask) >= MASK_THRESHOLD, light=project(light, 2))
    relit = np.stack([one * inside[..., None] for one in (found.positive, found.negative)])
    record = {"name": capture.name, "gradients": found.gradients.round(4).tolist(), "fit": round(found.fit, 4)}
    return Taken(Picture(shots, light, new, None, relit, seen), record)


LAYOUTS: dict[str, Callable[[Path, str, int], Source]] = {"humanolat": one_light_frames, "ultrastage": gradient_frames}
