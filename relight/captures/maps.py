"""Measures the maps of a capture, in the form of baked maps."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from relight.captures.camera import Pinhole
from relight.captures.capture import Capture, read_capture
from relight.captures.lightstage import LightStage
from relight.captures.measure import Measured, Radiance, measure
from relight.errors import UserError
from relight.maps import Maps
from relight.maps.square import MASK_THRESHOLD, crop_around, figure_means, fill_outside
from relight.meshes import read_mesh
from relight.progress import progress
from relight.sh import UNOCCLUDED_T00
from relight.srgb import to_bytes
from relight.transport.baker import primary_hits
from relight.transport.raycaster import RayCaster

WHITE_ALBEDO = 0.9  # assumed for the brightest hundredth of a person's albedo, since frames have an unknown scale
MIN_KNOWN = 0.5  # share of a person's pixels that enough frames must light


def training_maps(folder: Path, size: int) -> Maps:
    """Measures the maps of a capture on the person's square.

    Args:
        folder: folder of the capture.
        size: pixels of the square.

    Raises:
        UserError: if its files are missing, broken or inconsistent, or too few of its pixels are lit.
    """
    return crop_to_square(measure_maps(read_capture(folder))[1], size)


def measure_maps(capture: Capture, radiance: Radiance | None = None) -> tuple[Measured, Maps, float]:
    """Measures transport, albedo and normals of a capture, and renders it under panoramas.

    Args:
        capture: whose mask has P pixels inside.
        radiance: radiance of the panoramas to render the person under, in the camera's axes.

    Returns:
        The measurement, its maps at the frames' pixels, and the scale by which albedo and pictures must be divided.

    Raises:
        UserError: if the camera does not see the mesh, or too few pixels are lit.
    """
    inside, camera, stage = capture.mask >= MASK_THRESHOLD, capture.camera, capture.stage()
    if not inside.any():
        raise UserError(f"the mask of {capture.name} is empty: no pixel of it is at least half white")
    depth = surface_depth(capture, stage, inside)
    row, column = np.nonzero(inside)
    # The rays reach depth 1; rotated, they are in the camera's axes, in which the stage is.
    points = camera.rays(column + 0.5, row + 0.5)[:, 3:] @ camera.rotation.T * depth[inside][:, None]

    def frames() -> Iterator[tuple[int, np.ndarray]]:
        """Reads all frames (`Capture.read_frames`), and shows the progress."""
        return progress(capture.read_frames(inside), f"frames of {capture.name}", len(capture.frames))

    measured = measure(frames, stage, points, radiance)
    if (known := float(measured.known.mean())) < MIN_KNOWN:
        raise UserError(
            f"{capture.name}: enough frames light {known:.0%} of the person's pixels, and {MIN_KNOWN:.0%} are needed"
        )
    scale = float(np.quantile(measured.albedo[measured.known].max(1), 0.99)) / WHITE_ALBEDO
    maps = measured_maps(measured, scale, capture.mask, depth)
    record = {"lamps": len(capture.lamps), "known": round(known, 4), "clipped": round(measured.clipped, 6)}
    record |= {"projection_error": round(stage.error, 6)}
    maps.info = {"name": capture.name, "subject": capture.subject, "measured": record}
    return measured, maps, scale


def surface_depth(capture: Capture, stage: LightStage, inside: np.ndarray) -> np.ndarray:
    """Returns the depth (H,W) of the surface along the optical axis.

    Where the mesh is not visible, this is the depth of the nearest pixel where it is. Without a mesh, it is the depth
    of the stage's centre everywhere.

    Args:
        capture: with or without a mesh.
        stage: in the camera's frame.
        inside: (H,W) bool, the person's pixels.

    Raises:
        UserError: if the camera does not see the mesh.
    """
    if capture.mesh is None:
        return np.full(inside.shape, -stage.centre[2])
    mesh = read_mesh(capture.mesh)
    visible = to_image(mesh_depth(RayCaster(mesh.vertices, mesh.faces, threads=1), capture.camera, inside), inside)
    if not visible.any():
        raise UserError(f"{capture.mesh} is not in the picture: it must have the unit and the axes of the lamps")
    return fill_outside(visible, visible > 0)


def mesh_depth(caster: RayCaster, camera: Pinhole, inside: np.ndarray) -> np.ndarray:
    """Returns the depth (P,) of a mesh along the optical axis, at the centres of pixels; zero where rays miss it.

    Args:
        caster: of the mesh, in the world.
        camera: whose pixels these are.
        inside: (H,W) bool, the P pixels.
    """
    row, column = np.nonzero(inside)
    hits = primary_hits(caster, camera, column + 0.5, row + 0.5)
    depth = np.zeros(len(row))
    depth[hits.ray] = camera.depth(caster.points(hits.face, hits.weights))
    return depth


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


def crop_to_square(maps: Maps, size: int) -> Maps:
    """Resamples maps to the person's square: means over the figure in each pixel.

    Args:
        maps: (H,W,...) at the photo's pixels.
        size: pixels of the square.
    """
    box = crop_around(to_bytes(maps.coverage), size)
    inside, mean = figure_means(maps.coverage, maps.mask, box)
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


def to_image(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Returns values (P,...) of the pixels of `inside` (H,W) as an image (H,W,...) float32, zero outside."""
    whole = np.zeros((*inside.shape, *values.shape[1:]), np.float32)
    whole[inside] = values
    return whole
