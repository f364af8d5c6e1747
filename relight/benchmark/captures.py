"""Brings captures of real people into the benchmark's format, so that anyone's answers to them can be scored."""

import csv
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from relight.benchmark import humanolat, ultrastage
from relight.benchmark.bakedstage import agreement, bake_as_seen, depth_at_centres
from relight.benchmark.lights import panorama
from relight.benchmark.lightstage import Lighting, LightStage, Measured, coarse, measure
from relight.benchmark.make import FORMAT, index, same, save
from relight.benchmark.measures import Intrinsics
from relight.benchmark.picture import BRIGHTNESS, DARKEST, Picture, means, on_square
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
from relight.transport.raycaster import RayCaster

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


def import_captures(
    layout: str, source: Path | str, folder: Path | str, only: str = "", rays: int = 256, places: int = 4
) -> str:
    """Brings captures into a set; goes on where it was stopped.

    Args:
        layout: a key of LAYOUTS.
        source: folder of the data set as published.
        folder: of the set.
        only: a regular expression that the names of captures match anywhere; all by default.
        rays: of a pixel, for baking the captures' meshes.
        places: k x k of a pixel that share them.

    Returns:
        The set's hash.

    Raises:
        UserError: for another layout, another set in the folder, and files that are missing or broken.
    """
    if layout not in LAYOUTS:
        raise UserError(f"layout {layout}: {' or '.join(LAYOUTS)}")
    folder, settings = writable_folder(folder, "--out"), {"size": 2 * SIDE, "rays": rays, "places": places}
    names: list[str] = []
    figures: set[str] = set()
    for name, figure, take in LAYOUTS[layout](Path(source), only, rays, places):
        if not names:
            same(folder, {"format": FORMAT, "set": layout, "settings": settings})
        varied = figure not in figures  # one picture of each person is there in variants
        names.append(name)
        figures.add(figure)
        if not (folder / "inputs" / name).is_dir():
            taken = take(varied)
            if taken.agreement:
                write_agreement(folder / BAKED, name, taken.agreement)
            save(folder, name, figure, taken.record, taken.picture)
    return index(folder, layout, names, settings, scale="unknown")


def write_agreement(path: Path, name: str, row: dict[str, float]) -> None:
    """Adds the row of a picture to a table, or replaces it."""
    rows = {one["picture"]: one for one in read_table(path)[1]} if path.is_file() else {}
    rows[name] = {"picture": name, **{key: f"{value:.6g}" for key, value in row.items()}}
    with atomic_write(path) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[name]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[one] for one in sorted(rows))


def one_light_frames(source: Path, only: str, rays: int, places: int) -> Source:
    """The captures of HumanOLAT: `relight.benchmark.humanolat`."""
    for capture in humanolat.captures(source, only):
        yield capture.name, capture.subject, partial(photographed, capture, rays, places)


def photographed(capture: humanolat.Capture, rays: int, places: int, varied: bool) -> Taken:
    """Photographs a capture in a panorama and four new ones, as sums of its frames; the truth is what they measure."""
    mask = capture.read_mask()
    inside = mask >= MASK_THRESHOLD
    square = crop_around(mask, SIDE)
    capture.check_order(inside)
    baked = None
    if capture.model:
        baked = bake_as_seen(read_mesh(capture.model), capture.camera, inside, capture.stage(), rays, places)
    drawn = recipe(FIRST + zlib.crc32(capture.name.encode()) % FIRST, 1)
    sharp = [panorama(one, 0.0, BRIGHTNESS * 2**drawn.stops).pixels for one in (drawn.light, *drawn.new)]
    lights = coarse(np.stack(sharp), len(capture.lamps)).astype(np.float32)
    measured, maps, scale = measured_capture(capture, mask, baked.depth if baked else None, Lighting(lights))
    linear, *relit = np.moveaxis(on_image(measured.pictures / scale, inside), 2, 0)
    light, *new = (Panorama(one, source=f"{drawn.name}.{i}") for i, one in enumerate(lights))
    scene = linear + (1 - maps.coverage[..., None]) * np.pi * camera_view(light, mask.shape)

    def expose(gain: np.ndarray | float) -> np.ndarray:
        return to_bytes(encode(scene * gain))

    shots = variants(expose, mask, SIDE) if varied else {"": Shot(expose(1.0), mask, square)}
    shading = linear / np.maximum(maps.albedo, DARKEST) * inside[..., None]
    seen = on_square(maps, shading, project(light, 2), square)
    picture = Picture(shots, light, new, maps, np.stack([to_bytes(encode(one)) for one in relit]), seen)
    compared = agreement(measured, baked, inside) if baked else None
    return Taken(picture, {**asdict(drawn), "name": capture.name, **maps.info["measured"]}, compared)


def training_maps(place: Path, size: int) -> Maps:
    """Measures the maps of one camera's capture on the person's square, as they would be baked for training.

    Args:
        place: folder of its frames (`humanolat.list_captures`).
        size: pixels of the square.

    Raises:
        UserError: if its files are missing, broken, or do not fit each other, or too few of its pixels are lit.
    """
    capture = humanolat.read_capture(place)
    mask, depth = capture.read_mask(), None
    inside = mask >= MASK_THRESHOLD
    capture.check_order(inside)
    if capture.model:
        mesh = read_mesh(capture.model)
        depth = depth_at_centres(RayCaster(mesh.vertices, mesh.faces, threads=1), capture.camera, inside)
    return squared(measured_capture(capture, mask, depth)[1], size)


def measured_capture(
    capture: humanolat.Capture, mask: np.ndarray, depth: np.ndarray | None, lighting: Lighting | None = None
) -> tuple[Measured, Maps, float]:
    """Measures a capture.

    Args:
        capture: of P pixels.
        mask: (H,W) uint8.
        depth: (P,) of its mesh (`Baked.depth`), or None.
        lighting: panoramas to picture the person in.

    Returns:
        What was measured, the same as maps at the frames' pixels, and what albedo and pictures must be divided by.

    Raises:
        UserError: if the mesh is elsewhere, or too few pixels are lit.
    """
    inside = mask >= MASK_THRESHOLD
    if depth is not None and not depth.any():
        raise UserError(f"{capture.model} is not in the picture of {capture.name}: it must be in millimetres")
    camera, stage = capture.camera, capture.stage()
    surface = surface_depth(depth, stage, inside)
    row, column = np.nonzero(inside)
    points = camera.rays(column + 0.5, row + 0.5)[:, 3:] @ camera.rotation.T * surface[inside][:, None]

    def frames() -> Iterator[tuple[int, np.ndarray]]:
        return progress(capture.read_frames(inside), f"frames of {capture.name}", len(capture.frames))

    measured = measure(frames, stage, points, lighting)
    if (known := float(measured.known.mean())) < KNOWN:
        raise UserError(
            f"{capture.name}: {known:.0%} of the person's pixels are lit in enough frames, and {KNOWN:.0%} are needed"
        )
    scale = float(np.quantile(measured.albedo[measured.known].max(1), 0.99)) / WHITEST
    maps = measured_maps(measured, scale, mask, surface)
    facts = {"lamps": len(capture.lamps), "absent": capture.absent, "known": round(known, 4)}
    facts |= {"clipped": round(measured.clipped, 6), "projection_error": round(stage.error, 6)}
    maps.info = {"name": capture.name, "subject": capture.subject, "measured": facts}
    return measured, maps, scale


def surface_depth(depth: np.ndarray | None, stage: LightStage, inside: np.ndarray) -> np.ndarray:
    """Returns how far the surface is at each pixel (H,W), along the optical axis.

    That of the mesh (P,), where it is seen, and of the nearest such pixel elsewhere; without a mesh, that of the plane
    through the stage's centre which faces the camera.
    """
    if depth is None:
        return np.full(inside.shape, -stage.centre[2])
    seen = on_image(depth, inside)
    return fill_outside(seen, seen > 0)


def squared(maps: Maps, size: int) -> Maps:
    """Returns maps (H,W) on the person's square of `size` pixels: means over what of the person is in each of them."""
    box = crop_around(to_bytes(maps.coverage), size)
    inside, mean = means(maps, box)
    normal, transport = mean(maps.normal), mean(maps.transport)
    return Maps(
        mask=inside,
        coverage=box.extract(maps.coverage),
        albedo=mean(maps.albedo),
        normal=normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6),
        depth=mean(maps.depth[..., None])[..., 0],
        ao=(transport[..., 0] / np.float32(UNOCCLUDED_T00)).clip(0, 1),
        transport=transport,
        info=maps.info,
    )


def measured_maps(measured: Measured, scale: float, mask: np.ndarray, depth: np.ndarray) -> Maps:
    """Returns the maps of what was measured; pixels that too few lamps light take theirs from the nearest others.

    Args:
        measured: at the pixels of the mask.
        scale: that albedo is divided by.
        mask: (H,W) uint8.
        depth: (H,W).
    """
    inside = mask >= MASK_THRESHOLD
    known = on_image(measured.known, inside) > 0

    def filled(values: np.ndarray) -> np.ndarray:
        return fill_outside(on_image(values, inside), known) * inside[..., None]

    transport = filled(measured.transport)
    return Maps(
        mask=inside,
        coverage=mask / np.float32(255),
        albedo=filled(measured.albedo / scale),
        normal=filled(measured.normal),
        depth=(depth * inside).astype(np.float32),
        ao=(transport[..., 0] / np.float32(UNOCCLUDED_T00)).clip(0, 1),
        transport=transport,
    )


def on_image(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Returns values (P,...) of the pixels of `inside` (H,W) as an image (H,W,...) float32, zero outside."""
    whole = np.zeros((*inside.shape, *values.shape[1:]), np.float32)
    whole[inside] = values
    return whole


def gradient_frames(source: Path, only: str, rays: int, places: int) -> Source:
    """The captures of UltraStage: `relight.benchmark.ultrastage`."""
    for capture in ultrastage.captures(source, only):
        yield capture.name, capture.figure, partial(gradients, capture)


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
    seen = Intrinsics(square.extract(found.mask) >= MASK_THRESHOLD, light=project(light, 2))
    relit = np.stack([one * inside[..., None] for one in (found.positive, found.negative)])
    record = {"name": capture.name, "gradients": found.gradients.round(4).tolist(), "fit": round(found.fit, 4)}
    return Taken(Picture(shots, light, new, None, relit, seen), record)


LAYOUTS: dict[str, Callable[[Path, str, int, int], Source]] = {
    "humanolat": one_light_frames,
    "ultrastage": gradient_frames,
}
