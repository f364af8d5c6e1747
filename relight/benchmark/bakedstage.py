"""Bakes transport from a capture's mesh, and compares it with the transport measured from the frames."""

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

EDGE_PIXELS = 2  # along the mask's edge, left out of the comparison


@dataclass
class Baked:
    """A mesh as a calibrated camera sees it, at P pixels, in the camera's axes.

    Attributes:
        hit: (P,) bool, whether the mesh covers the whole pixel.
        depth: (P,) at the pixel's centre, along the optical axis; zero where the ray misses.
        normal: (P,3) unit.
        transport: (P,9) of distant light, by cosine-distributed rays.
        lamp_sums: (P,9) by one ray to each lamp, summed as frames are: the measurement from frames without noise.
    """

    hit: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    transport: np.ndarray
    lamp_sums: np.ndarray


def bake_as_seen(
    mesh: Mesh, camera: Pinhole, inside: np.ndarray, stage: LightStage, rays: int, supersample: int = 4, seed: int = 0
) -> Baked:
    """Bakes a mesh at the pixels of a calibrated camera.

    A photograph holds the mean over a pixel's area, so transport and normals are means over k x k points of a pixel,
    which share its rays. Each lamp has one ray per pixel, from one of these points in turn.

    Args:
        mesh: in the camera's world.
        camera: calibrated.
        inside: (H,W) bool, the P pixels.
        stage: the lamps, in the camera's frame.
        rays: per pixel.
        supersample: k; 1 takes the pixel's centre alone.
        seed: of the rays' azimuths.

    Raises:
        UserError: if `RayCaster` refuses the mesh, or there are fewer rays than points.
    """
    if rays < supersample**2:
        raise UserError(
            f"--rays {rays}: must be at least {supersample**2}, one for each of {supersample} x {supersample} points"
        )
    caster, normals = RayCaster(mesh.vertices, mesh.faces, threads=1), vertex_normals(mesh)
    row, column = np.nonzero(inside)
    azimuth = random_azimuths(len(row), seed)
    hits, depth = np.zeros(len(row), int), depth_at_centres(caster, camera, inside)
    normal, transport, lamp_sums = (np.zeros((len(row), width)) for width in (3, 9, 9))
    steps = (np.arange(supersample) + 0.5) / supersample
    for number, (down, right) in enumerate(progress(list(product(steps, steps)), "points of each pixel")):
        found = primary_hits(caster, camera, column + right, row + down)
        points, geometric = caster.points(found.face, found.weights), caster.normals[found.face]
        shading = shading_normals(normals, mesh.faces, found.face, found.weights, geometric)
        side = np.where(faces_away(camera, points, geometric), -1.0, 1.0)[:, None]
        shading, geometric = shading * side, geometric * side
        subset = (number, supersample**2)
        contribution, _ = integrate(
            caster,
            points,
            shading,
            geometric,
            rays,
            azimuth=azimuth[found.ray],
            subset=subset if supersample > 1 else (0, 1),
        )
        hits[found.ray] += 1
        transport[found.ray] += contribution
        normal[found.ray] += shading
        for lamp in range(number, len(stage.positions), supersample**2):
            lamp_sums[found.ray] += lamp_transport(caster, camera, stage, lamp, points, shading, geometric)
    covered = hits == supersample**2
    normal = normal @ camera.rotation.T
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    camera_transport = transport @ rotation_matrix(camera.rotation).T / np.maximum(hits, 1)[:, None]
    return Baked(covered & (depth > 0), depth, normal, camera_transport, lamp_sums)


def depth_at_centres(caster: RayCaster, camera: Pinhole, inside: np.ndarray) -> np.ndarray:
    """Returns the depth (P,) of a mesh, as `Baked.depth`, at the centres of the pixels of `inside` (H,W)."""
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
    """Returns the contribution (N,9) of a lamp to the transport at points, by one shadow ray from each.

    Args:
        caster: of the mesh.
        camera: whose axes the stage and the result have.
        stage: with the lamp.
        lamp: its number.
        points: (N,3), in the world like the normals.
        normals: (N,3), shading normals.
        geometric: (N,3), normals along which the rays' origins are offset.
    """
    toward, weight, falloff = stage.lamp_seen_from(lamp, (points - camera.eye) @ camera.rotation.T)
    ray = toward @ camera.rotation
    cosine = np.einsum("pi,pi->p", normals, ray)
    lit = np.flatnonzero(cosine > 0)
    start = caster.to_local(points[lit] + caster.offset * geometric[lit])
    lit = lit[~caster.occluded(np.concatenate([start, ray[lit].astype(np.float32)], 1))]
    contribution = np.zeros((len(points), 9))
    contribution[lit] = (weight[lit] * falloff[lit] * cosine[lit])[:, None] * basis(toward[lit])
    return contribution


def agreement(measured: Measured, baked: Baked, inside: np.ndarray) -> dict[str, float]:
    """Compares measured with baked transport where both are known, away from the mask's edge.

    Lengths are RMS lengths of vectors of nine over the pixels.

    Returns:
        shown: fraction of all pixels that the mesh covers.
        pixels: number of pixels compared.
        length: of baked transport.
        difference: of measured minus baked transport.
        shape: the same after the best factor for each pixel, which removes the error of the measured albedo.
        lamps: of `Baked.lamp_sums` minus baked transport: the quadrature error of finitely many near lamps.
        rest: of measured transport minus `Baked.lamp_sums`: gloss, bounces, motion, mesh, unequal lamps, noise.
        noise: of the predicted effect of rounding to 8 bits.
        factor: by which measured transport is nearest to baked transport.
        normals: median angle between measured normals and those of the mesh, degrees.
    """
    inner = binary_erosion(inside, iterations=EDGE_PIXELS)[inside]
    compared = measured.known & baked.hit & inner

    def length(values: np.ndarray) -> float:
        return float(np.sqrt((values[compared] ** 2).sum(1).mean())) if compared.any() else float("nan")

    product = np.einsum("pk,pk->p", measured.transport, baked.transport)
    square = np.maximum(np.einsum("pk,pk->p", measured.transport, measured.transport), 1e-12)
    cosine = np.clip(np.einsum("pi,pi->p", measured.normal[compared], baked.normal[compared]), -1, 1)
    return {
        "shown": float(baked.hit.mean()),
        "pixels": int(compared.sum()),
        "length": length(baked.transport),
        "difference": length(measured.transport - baked.transport),
        "shape": length((product / square)[:, None] * measured.transport - baked.transport),
        "lamps": length(baked.lamp_sums - baked.transport),
        "rest": length(measured.transport - baked.lamp_sums),
        "noise": length(measured.noise),
        "factor": float(product[compared].sum() / max(square[compared].sum(), 1e-12)),
        "normals": float(np.degrees(np.median(np.arccos(cosine)))) if compared.any() else float("nan"),
    }
