"""Imports captures of real people as sets of the benchmark."""

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
from relight.benchmark.lightstage import LightStage, Measured, Panoramas, blur_to_spacing, measure
from relight.benchmark.make import FORMAT, check_plan, save_picture, write_index
from relight.benchmark.measures import Intrinsics
from relight.benchmark.picture import BRIGHTNESS, MIN_ALBEDO, Picture, figure_means, on_square
from relight.benchmark.recipes import draw_recipe
from relight.benchmark.shots import Shot, variants
from relight.files import UserError, atomic_write, writable_folder
from relight.maps import Maps
from relight.meshes import read_mesh
from relight.panoramas import Panorama, project
from relight.panoramas.radiosity import HEIGHT, WIDTH, view_directions
from relight.photos.crop import MASK_THRESHOLD, crop_around, fill_outside
from relight.photos.environment import camera_view
from relight.progress import progress
from relight.sh import UNOCCLUDED_T00
from relight.srgb import LINEAR, encode, to_bytes
from relight.text import read_table
from relight.transport.raycaster import RayCaster

SQUARE_SIZE = 256  # pixels, of the square on which maps are compared
FIRST_SEED = 10_000_000  # of the lights; above the seeds of all other sets
WHITE_ALBEDO = 0.9  # assumed for the brightest hundredth of a person's albedo, since frames have an unknown scale
MIN_KNOWN = 0.5  # share of a person's pixels that enough frames must light
BAKED_TABLE = "baked.csv"


@dataclass(frozen=True)
class Imported:
    """A picture imported from a capture.

    Attributes:
        picture: photographs, lights and ground truth.
        record: how it was made, for picture.json.
        agreement: measured against baked transport (`bakedstage.agreement`); None without a mesh.
    """

    picture: Picture
    record: dict
    agreement: dict[str, float] | None = None


# Of each picture: its name, its figure, and a function that imports it, with variants or without.
Jobs = Iterator[tuple[str, str, Callable[[bool], Imported]]]


def import_captures(
    layout: str, source: Path | str, folder: Path | str, only: str = "", rays: int = 256, supersample: int = 4
) -> str:
    """Imports captures into a set, resuming where it was stopped.

    Args:
        layout: a key of LAYOUTS.
        source: folder of the data set as published.
        folder: of the set.
        only: a regular expression that names of captures must match anywhere; by default all do.
        rays: per pixel, for baking the captures' meshes.
        supersample: k, where baked maps are means over k x k points of a pixel.

    Returns:
        The set's hash.

    Raises:
        UserError: for an unknown layout, another set in the folder, or files that are missing or broken.
    """
    if layout not in LAYOUTS:
        raise UserError(f"layout {layout}: must be {' or '.join(LAYOUTS)}")
    folder, settings = writable_folder(folder, "--out"), {"size": 2 * SQUARE_SIZE, "rays": rays, "places": supersample}
    names: list[str] = []
    figures: set[str] = set()
    for name, figure, run_job in LAYOUTS[layout](Path(source), only, rays, supersample):
        if not names:
            check_plan(folder, {"format": FORMAT, "set": layout, "settings": settings, "only": only})
        with_variants = figure not in figures  # the first picture of each figure has variants
        names.append(name)
        figures.add(figure)
        if not (folder / "inputs" / name).is_dir():
            imported = run_job(with_variants)
            if imported.agreement:
                write_agreement(folder / BAKED_TABLE, name, imported.agreement)
            save_picture(folder, name, figure, imported.record, imported.picture)
    return write_index(folder, layout, names, settings, scale="unknown")


def write_agreement(path: Path, name: str, row: dict[str, float]) -> None:
    """Adds the row of a picture to a CSV table, or replaces it."""
    rows = {one["picture"]: one for one in read_table(path)[1]} if path.is_file() else {}
    rows[name] = {"picture": name, **{key: f"{value:.6g}" for key, value in row.items()}}
    with atomic_write(path) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[name]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[one] for one in sorted(rows))


def humanolat_jobs(source: Path, only: str, rays: int, supersample: int) -> Jobs:
    """Yields the pictures of a folder in HumanOLAT's layout (`relight.benchmark.humanolat`)."""
    for capture in humanolat.captures(source, only):
        yield capture.name, capture.subject, partial(import_olat, capture, rays, supersample)


def import_olat(capture: humanolat.Capture, rays: int, supersample: int, with_variants: bool) -> Imported:
    """Renders a capture in one panorama and four new ones as sums of its frames, and measures the ground truth."""
    mask = capture.read_mask()
    inside = mask >= MASK_THRESHOLD
    square = crop_around(mask, SQUARE_SIZE)
    capture.check_order(inside)
    baked = None
    if capture.model:
        baked = bake_as_seen(read_mesh(capture.model), capture.camera, inside, capture.stage(), rays, supersample)
    recipe = draw_recipe(FIRST_SEED + zlib.crc32(capture.name.encode()) % FIRST_SEED, 1)
    sharp = [panorama(one, 0.0, BRIGHTNESS * 2**recipe.stops).pixels for one in (recipe.light, *recipe.new)]
    lights = blur_to_spacing(np.stack(sharp), len(capture.lamps)).astype(np.float32)
    measured, maps, scale = measured_capture(capture, mask, baked.depth if baked else None, Panoramas(lights))
    linear, *relit = np.moveaxis(to_image(measured.pictures / scale, inside), 2, 0)
    light, *new = (Panorama(one, source=f"{recipe.name}.{i}") for i, one in enumerate(lights))
    scene = linear + (1 - maps.coverage[..., None]) * np.pi * camera_view(light, mask.shape)

    def expose(gain: np.ndarray | float) -> np.ndarray:
        return to_bytes(encode(scene * gain))

    shots = variants(expose, mask, SQUARE_SIZE) if with_variants else {"": Shot(expose(1.0), mask, square)}
    shading = linear / np.maximum(maps.albedo, MIN_ALBEDO) * inside[..., None]
    truth = on_square(maps, shading, project(light, 2), square)
    picture = Picture(shots, light, new, maps, np.stack([to_bytes(encode(one)) for one in relit]), truth)
    comparison = agreement(measured, baked, inside) if baked else None
    return Imported(picture, {**asdict(recipe), "name": capture.name, **maps.info["measured"]}, comparison)


def training_maps(folder: Path, size: int) -> Maps:
    """Measures the maps of a capture on the person's square, in the form of baked maps for training.

    Args:
        folder: of its frames (`humanolat.list_captures`).
        size: pixels of the square.

    Raises:
        UserError: if its files are missing, broken or inconsistent, or too few of its pixels are lit.
    """
    capture = humanolat.read_capture(folder)
    mask, depth = capture.read_mask(), None
    inside = mask >= MASK_THRESHOLD
    capture.check_order(inside)
    if capture.model:
        mesh = read_mesh(capture.model)
        depth = depth_at_centres(RayCaster(mesh.vertices, mesh.faces, threads=1), capture.camera, inside)
    return crop_to_square(measured_capture(capture, mask, depth)[1], size)


def measured_capture(
    capture: humanolat.Capture, mask: np.ndarray, depth: np.ndarray | None, panoramas: Panoramas | None = None
) -> tuple[Measured, Maps, float]:
    """Measures transport, albedo and normals of a capture, and renders it under panoramas.

    Args:
        capture: whose mask has P pixels inside.
        mask: (H,W) uint8.
        depth: (P,) of its mesh (`Baked.depth`), or None.
        panoramas: to render the person under.

    Returns:
        The measurement, its maps at the frames' pixels, and the scale by which albedo and pictures must be divided.

    Raises:
        UserError: if the camera does not see the mesh, or too few pixels are lit.
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

    measured = measure(frames, stage, points, panoramas)
    if (known := float(measured.known.mean())) < MIN_KNOWN:
        raise UserError(
            f"{capture.name}: enough frames light {known:.0%} of the person's pixels, and {MIN_KNOWN:.0%} are needed"
        )
    scale = float(np.quantile(measured.albedo[measured.known].max(1), 0.99)) / WHITE_ALBEDO
    maps = measured_maps(measured, scale, mask, surface)
    record = {"lamps": len(capture.lamps), "absent": capture.missing, "known": round(known, 4)}
    record |= {"clipped": round(measured.clipped, 6), "projection_error": round(stage.error, 6)}
    maps.info = {"name": capture.name, "subject": capture.subject, "measured": record}
    return measured, maps, scale


def surface_depth(depth: np.ndarray | None, stage: LightStage, inside: np.ndarray) -> np.ndarray:
    """Returns the depth (H,W) of the surface along the optical axis.

    Where the mesh is not visible, this is the depth of the nearest pixel where it is. Without a mesh, it is the depth
    of the stage's centre everywhere.

    Args:
        depth: (P,) of the mesh, zero where not visible, or None.
        stage: in the camera's frame.
        inside: (H,W) bool, the P pixels.
    """
    if depth is None:
        return np.full(inside.shape, -stage.centre[2])
    visible = to_image(depth, inside)
    return fill_outside(visible, visible > 0)


def crop_to_square(maps: Maps, size: int) -> Maps:
    """Returns maps (H,W) resampled to the person's square of `size` pixels: means over the figure in each pixel."""
    box = crop_around(to_bytes(maps.coverage), size)
    inside, mean = figure_means(maps, box)
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
    """Returns measured maps; pixels lit by too few lamps have the values of the nearest other pixels.

    Args:
        measured: at the pixels inside the mask.
        scale: divisor of the albedo.
        mask: (H,W) uint8.
        depth: (H,W).
    """
    inside = mask >= MASK_THRESHOLD
    known = to_image(measured.known, inside) > 0

    def filled(values: np.ndarray) -> np.ndarray:
        return fill_outside(to_image(values, inside), known) * inside[..., None]

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


def to_image(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Returns values (P,...) of the pixels of `inside` (H,W) as an image (H,W,...) float32, zero outside."""
    whole = np.zeros((*inside.shape, *values.shape[1:]), np.float32)
    whole[inside] = values
    return whole


def ultrastage_jobs(source: Path, only: str, rays: int, supersample: int) -> Jobs:
    """Yields the pictures of a folder in UltraStage's layout (`relight.benchmark.ultrastage`)."""
    for capture in ultrastage.captures(source, only):
        yield capture.name, capture.figure, partial(import_gradients, capture)


def import_gradients(capture: ultrastage.Capture, with_variants: bool) -> Imported:
    """Imports the picture under all lamps, with the two gradients as new lights, whose true pictures are published.

    The photograph's light is the same from all directions. Albedo and transport are unknown.
    """
    found = ultrastage.read(capture)
    square = crop_around(found.mask, SQUARE_SIZE)
    even = np.full((HEIGHT, WIDTH, 3), BRIGHTNESS / np.pi, np.float32)
    directions = view_directions().reshape(HEIGHT, WIDTH, 3)
    slope = directions @ (capture.rotation @ found.gradients.T)  # of each channel
    light = Panorama(even, source="full on")
    new = [Panorama((even * found.level * (1 + sign * slope) / 2).astype(np.float32)) for sign in (1, -1)]
    linear = LINEAR[found.full_on]
    inside = found.mask >= MASK_THRESHOLD

    def expose(gain: np.ndarray | float) -> np.ndarray:
        return to_bytes(encode(linear * gain))

    shots = (
        variants(expose, found.mask, SQUARE_SIZE) if with_variants else {"": Shot(found.full_on, found.mask, square)}
    )
    truth = Intrinsics(square.extract(found.mask) >= MASK_THRESHOLD, light=project(light, 2))
    relit = np.stack([one * inside[..., None] for one in (found.positive, found.negative)])
    record = {"name": capture.name, "gradients": found.gradients.round(4).tolist(), "fit": round(found.fit, 4)}
    return Imported(Picture(shots, light, new, None, relit, truth), record)


LAYOUTS: dict[str, Callable[[Path, str, int, int], Jobs]] = {
    "humanolat": humanolat_jobs,
    "ultrastage": ultrastage_jobs,
}
