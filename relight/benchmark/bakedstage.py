"""Transport baked from a capture's mesh, to set beside what its frames measure."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from relight.benchmark.lightstage import LightStage, Measured, Pinhole
from relight.meshes import Mesh, vertex_normals
from relight.progress import progress
from relight.sh import basis, rotation_matrix
from relight.transport.baker import faces_away, primary_hits
from relight.transport.integrate import integrate
from relight.transport.raycaster import RayCaster
from relight.transport.surface import shading_normals

INWARD = 2  # pixels that are left out along the mask's edge


@dataclass
class Baked:
    """A mesh as a calibrated camera sees it, at P pixels, in the camera's axes.

    Attributes:
        hit: (P,) bool, whether the pixel's centre shows the mesh; all else is zero where it does not.
        depth: (P,) along the optical axis.
        normal: (P,3).
        transport: (P,9) by cosine-distributed rays, of distant light.
        staged: (P,9) by one ray to each lamp, summed up as the frames are: what frames without noise would measure.
    """

    hit: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    transport: np.ndarray
    staged: np.ndarray


def bake_as_seen(mesh: Mesh, camera: Pinhole, inside: np.ndarray, stage: LightStage, rays: int, seed: int = 0) -> Baked:
    """Bakes a mesh at the pixels that a camera shows it at.

    Args:
        mesh: in the world of the camera.
        camera: calibrated.
        inside: (H,W) bool, the P pixels.
        stage: its lamps, in the camera's frame.
        rays: per pixel.
        seed: of the rays' azimuths.

    Raises:
        UserError: if `RayCaster` refuses the mesh.
    """
    caster = RayCaster(mesh.vertices, mesh.faces, threads=1)
    row, column = np.nonzero(inside)
    hits = primary_hits(caster, camera, column + 0.5, row + 0.5)
    points, geometric = caster.points(hits.face, hits.weights), caster.normals[hits.face]
    normals = shading_normals(vertex_normals(mesh), mesh.faces, hits.face, hits.weights, geometric)
    side = np.where(faces_away(camera, points, geometric), -1.0, 1.0)[:, None]
    normals, geometric = normals * side, geometric * side
    transport, _ = integrate(caster, points, normals, geometric, rays, seed=seed)
    staged = np.zeros((len(points), 9))
    start = caster.to_local(points + caster.offset * geometric)
    seen = (points - camera.eye) @ camera.rotation.T
    facing = normals @ camera.rotation.T
    for lamp in progress(range(len(stage.positions)), "rays to lamps"):
        toward, weight, falloff = stage.seen_from(lamp, seen)
        lit = np.flatnonzero(np.einsum("pi,pi->p", facing, toward) > 0)
        bundle = np.concatenate([start[lit], (toward[lit] @ camera.rotation).astype(np.float32)], 1)
        lit = lit[~caster.occluded(bundle)]
        cosine = np.einsum("pi,pi->p", facing[lit], toward[lit])
        staged[lit] += (weight[lit] * falloff[lit] * cosine)[:, None] * basis(toward[lit])

    def everywhere(values: np.ndarray) -> np.ndarray:
        whole = np.zeros((len(row), *values.shape[1:]))
        whole[hits.ray] = values
        return whole

    turned = transport @ rotation_matrix(camera.rotation).T
    hit = np.zeros(len(row), bool)
    hit[hits.ray] = True
    return Baked(hit, everywhere(camera.depth(points)), everywhere(facing), everywhere(turned), everywhere(staged))


def agreement(measured: Measured, baked: Baked, inside: np.ndarray) -> dict[str, float]:
    """Compares measured with baked transport, over pixels that both know and that are not at the mask's edge.

    Returns:
        shown: share of all pixels that show the mesh.
        pixels: how many are compared.
        length: RMS length of the baked vectors of nine.
        difference: RMS length of measured minus baked transport.
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

    cosine = np.clip(np.einsum("pi,pi->p", measured.normal[both], baked.normal[both]), -1, 1)
    product = (measured.transport * baked.transport)[both].sum()
    return {
        "shown": float(baked.hit.mean()),
        "pixels": int(both.sum()),
        "length": length(baked.transport),
        "difference": length(measured.transport - baked.transport),
        "lamps": length(baked.staged - baked.transport),
        "rest": length(measured.transport - baked.staged),
        "noise": length(measured.noise),
        "factor": float(product / max((measured.transport[both] ** 2).sum(), 1e-12)),
        "normals": float(np.degrees(np.median(np.arccos(cosine)))) if both.any() else float("nan"),
    }
