"""Transport baked from a capture's mesh, to set beside what its frames measure."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.ndimage import binary_erosion

from relight.benchmark.lightstage import LightStage, Measured, Pinhole
from relight.files import UserError
from relight.meshes import Mesh, vertex_normals
from relight.progress import progress
from relight.sh import basis, rotation_matrix
from relight.transport.baker import faces_away, primary_hits
from relight.transport.integrate import integrate
from relight.transport.raycaster import RayCaster
from relight.transport.sampling import random_azimuths
from relight.transport.surface import shading_normals

INWARD = 2  # pixels that are left out along the mask's edge


@dataclass
class Baked:
    """A mesh as a calibrated camera sees it, at P pixels, in the camera's axes.

    Attributes:
        hit: (P,) bool, whether all of the pixel shows the mesh.
        depth: (P,) of the pixel's centre along the optical axis, zero where it shows nothing.
        normal: (P,3).
        transport: (P,9) by cosine-distributed rays, of distant light.
        staged: (P,9) by one ray to each lamp, summed up as the frames are: what frames without noise would measure.
    """

    hit: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    transport: np.ndarray
    staged: np.ndarray


def bake_as_seen(
    mesh: Mesh, camera: Pinhole, inside: np.ndarray, stage: LightStage, rays: int, places: int = 4, seed: int = 0
) -> Baked:
    """Bakes a mesh at the pixels that a camera shows it at.

    Photographs hold the mean over a pixel's area, so transport and normals are means over k x k places of it, which
    share its rays. Each lamp has one ray from a pixel, from one of the places in turn.

    Args:
        mesh: in the world of the camera.
        camera: calibrated.
        inside: (H,W) bool, the P pixels.
        stage: its lamps, in the camera's frame.
        rays: per pixel.
        places: k; 1 is the pixel's centre alone.
        seed: of the rays' azimuths.

    Raises:
        UserError: if `RayCaster` refuses the mesh, or there are more places than rays.
    """
    if rays < places**2:
        raise UserError(f"--rays {rays}: {places**2} at least, one for each of the pixel's {places} x {places} places")
    caster, normals = RayCaster(mesh.vertices, mesh.faces, threads=1), vertex_normals(mesh)
    row, column = np.nonzero(inside)
    azimuth = random_azimuths(len(row), seed)
    hits, depth = np.zeros(len(row), int), depth_at_centres(caster, camera, inside)
    normal, transport, staged = (np.zeros((len(row), width)) for width in (3, 9, 9))
    steps = (np.arange(places) + 0.5) / places
    for number, (down, right) in enumerate(progress(list(product(steps, steps)), "places of each pixel")):
        found = primary_hits(caster, camera, column + right, row + down)
        points, geometric = caster.points(found.face, found.weights), caster.normals[found.face]
        shading = shading_normals(normals, mesh.faces, found.face, found.weights, geometric)
        side = np.where(faces_away(camera, points, geometric), -1.0, 1.0)[:, None]
        shading, geometric = shading * side, geometric * side
        subset = (number, places**2)
        part, _ = integrate(
            caster,
            points,
            shading,
            geometric,
            rays,
            azimuth=azimuth[found.ray],
            subset=subset if places > 1 else (0, 1),
        )
        hits[found.ray] += 1
        transport[found.ray] += part
        normal[found.ray] += shading
        for lamp in range(number, len(stage.positions), places**2):
            staged[found.ray] += lamp_transport(caster, camera, stage, lamp, points, shading, geometric)
    everywhere = hits == places**2
    normal = normal @ camera.rotation.T
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    turned = transport @ rotation_matrix(camera.rotation).T / np.maximum(hits, 1)[:, None]
    return Baked(everywhere & (depth > 0), depth, normal, turned, staged)


def depth_at_centres(caster: RayCaster, camera: Pinhole, inside: np.ndarray) -> np.ndarray:
    """Returns the depth (P,), as `Baked.depth`, of a caster's mesh at the centres of the pixels of `inside` (H,W)."""
    row, column = np.nonzero(inside)
    found = primary_hits(caster, camera, column + 0.5, row + 0.5)
    depth = np.zeros(len(row))
    depth[found.ray] = camera.depth(caster.points(found.face, found.weights))
    return depth


def lamp_transport(
    caster: RayCaster,
    camera: Pinhole,
    stage: LightStage,
    lamp: int,
    points: np.ndarray,
    normals: np.ndarray,
    geometric: np.ndarray,
) -> np.ndarray:
    """Returns a lamp's part (N,9), in the camera's axes, of the transport of points, by one ray to it from each.

    Args:
        caster: of the mesh.
        camera: that the stage's frame is of.
        stage: with the lamp.
        lamp: its number.
        points: (N,3) of the world, as normals and geometric normals.
        normals: (N,3) for the cosine.
        geometric: (N,3) along which rays start off the surface.
    """
    toward, weight, falloff = stage.seen_from(lamp, (points - camera.eye) @ camera.rotation.T)
    ray = toward @ camera.rotation
    cosine = np.einsum("pi,pi->p", normals, ray)
    lit = np.flatnonzero(cosine > 0)
    start = caster.to_local(points[lit] + caster.offset * geometric[lit])
    lit = lit[~caster.occluded(np.concatenate([start, ray[lit].astype(np.float32)], 1))]
    part = np.zeros((len(points), 9))
    part[lit] = (weight[lit] * falloff[lit] * cosine[lit])[:, None] * basis(toward[lit])
    return part


def agreement(measured: Measured, baked: Baked, inside: np.ndarray) -> dict[str, float]:
    """Compares measured with baked transport, over pixels that both know and that are not at the mask's edge.

    Returns:
        shown: share of all pixels that show the mesh.
        pixels: how many are compared.
        length: RMS length of the baked vectors of nine.
        difference: RMS length of measured minus baked transport.
        shape: the same after the factor of each pixel that brings them nearest, so without the measured albedo's error.
        lamps: of what finitely many near lamps make of the baked one (`Baked.staged`), minus baked.
        rest: of measured minus that: gloss, bounces, motion, the mesh, the lamps' own differences, and noise.
        noise: what the rounding to 8 bits alone would make of it.
        factor: that brings measured nearest to baked transport.
        normals: median angle between measured normals and the mesh's, degrees.
    """
    away = binary_erosion(inside, iterations=INWARD)[inside]
    both = measured.known & baked.hit & away

    def length(values: np.ndarray) -> float:
        return float(np.sqrt((values[both] ** 2).sum(1).mean())) if both.any() else float("nan")

    product = np.einsum("pk,pk->p", measured.transport, baked.transport)
    square = np.maximum(np.einsum("pk,pk->p", measured.transport, measured.transport), 1e-12)
    cosine = np.clip(np.einsum("pi,pi->p", measured.normal[both], baked.normal[both]), -1, 1)
    return {
        "shown": float(baked.hit.mean()),
        "pixels": int(both.sum()),
        "length": length(baked.transport),
        "difference": length(measured.transport - baked.transport),
        "shape": length((product / square)[:, None] * measured.transport - baked.transport),
        "lamps": length(baked.staged - baked.transport),
        "rest": length(measured.transport - baked.staged),
        "noise": length(measured.noise),
        "factor": float(product[both].sum() / max(square[both].sum(), 1e-12)),
        "normals": float(np.degrees(np.median(np.arccos(cosine)))) if both.any() else float("nan"),
    }
