"""Bakes the maps of one mesh: what the camera sees, and the light transport at each pixel."""

import math

import numpy as np

from relight.files import UserError
from relight.maps.maps import Maps
from relight.meshes.mesh import Mesh
from relight.meshes.normals import vertex_normals
from relight.transport.bounce import reflectors
from relight.transport.camera import Camera
from relight.transport.integrate import BATCH, at_least, integrate
from relight.transport.scene import MISS, Scene
from relight.transport.surface import albedo, shading_normals

OPEN = math.sqrt(math.pi) / 2  # T00 of a point that nothing occludes, .8862


def bake(
    mesh: Mesh,
    size: int,
    rays: int,
    order: int = 2,
    seed: int = 0,
    supersample: int = 1,
    bounces: int = 0,
    perspective: float | None = None,
    threads: int = 1,
) -> Maps:
    """Maps of an aligned mesh on a `size` px image, with `rays` per pixel and (order + 1)^2 transport coefficients.

    The camera is orthographic; `perspective` is the eye's distance from the origin in scene units (1.8 is the
    figure's height), if given. All maps but two are taken at the pixel's centre; with `supersample` = k > 1 coverage
    and albedo are means over k x k places of the pixel. With `bounces` > 0, `bounced` holds what interreflection
    adds, with the mesh's albedo. Faces are seen from both sides; a visible back counts with its normal turned to the
    camera. `threads` = 0 takes every core; threads change no bit of the result. Time and memory: docs/transport.md.

    UserError on settings out of range, on meshes that Scene refuses, and when the camera sees nothing of the mesh.
    """
    at_least(1, rays=rays, supersample=supersample)
    at_least(0, order=order, bounces=bounces)
    scene = Scene(mesh.vertices, mesh.faces, threads)
    if perspective is None:
        camera = Camera(size, max(2.0, float(scene.high[2]) + scene.diagonal / 100))
    else:
        camera = Camera(size, perspective, perspective=True)
        if scene.high[2] >= perspective:
            raise UserError(f"the mesh reaches z = {scene.high[2]:.3g}, behind a perspective camera at {perspective:g}")

    row, column = np.divmod(np.arange(size * size), size)
    pixel, face, weights = see(scene, camera, column + 0.5, row + 0.5)
    if len(pixel) == 0:
        raise UserError(
            "the camera sees nothing of the mesh: it spans "
            + ", ".join(f"{axis} {a:.3g} to {b:.3g}" for axis, a, b in zip("xyz", scene.low, scene.high))
            + ", and the image shows x and y from -1 to 1; align it first"
        )
    points = scene.points(face, weights)
    geometric = scene.normals[face]
    normals = shading_normals(vertex_normals(mesh), mesh.faces, face, weights, geometric)
    back = np.einsum("nx,nx->n", geometric, camera.toward(points)) < 0
    side = np.where(back, -1.0, 1.0)[:, None]
    geometric, normals = geometric * side, normals * side

    lit, radiosity = reflectors(mesh, scene, rays, order, seed, bounces) if bounces else (scene, None)
    transport, gathered = integrate(lit, points, normals, geometric, rays, order, seed, radiosity)
    color = albedo(mesh, face, weights)
    coverage = np.zeros(size * size, np.float32)
    coverage[pixel] = 1
    if supersample > 1:
        coverage, color = _antialias(mesh, scene, camera, supersample, pixel, color)

    def spread(values: np.ndarray) -> np.ndarray:
        image = np.zeros((size * size, *values.shape[1:]), values.dtype)
        image[pixel] = values
        return image.reshape(size, size, *values.shape[1:])

    return Maps(
        mask=spread(np.ones(len(pixel), bool)),
        coverage=coverage.reshape(size, size),
        albedo=spread(color),
        normal=spread(normals.astype(np.float32)),
        depth=spread((camera.distance - points[:, 2]).astype(np.float32)),
        ao=spread((transport[:, 0] / np.float32(OPEN)).clip(0, 1)),
        transport=spread(transport),
        bounced=None if gathered is None else spread(gathered),
        info={
            **mesh.info,
            "size": size,
            "rays": rays,
            "order": order,
            "ray_seed": seed,  # the figure has a seed of its own
            "supersample": supersample,
            "bounces": bounces,
            "camera": "perspective" if camera.perspective else "orthographic",
            "camera_distance": round(camera.distance, 6),
            "offset": scene.offset,
            "backs": round(float(back.mean()), 4),  # share of the pixels that show the back of a face
        },
    )


def see(scene: Scene, camera: Camera, column: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, ...]:
    """What the camera sees at pixel coordinates (N,): which of them meet the mesh (P,), in which face, and where."""
    found, faces, places = [], [], []
    for begin in range(0, len(column), BATCH):
        rays = camera.rays(column[begin : begin + BATCH], row[begin : begin + BATCH])
        rays[:, :3] -= scene.centre
        face, weights = scene.first(rays.astype(np.float32))
        hit = np.flatnonzero(face != MISS)
        found.append(hit + begin)
        faces.append(face[hit].astype(np.int64))
        places.append(weights[hit])
    return np.concatenate(found), np.concatenate(faces), np.concatenate(places)


def _antialias(
    mesh: Mesh, scene: Scene, camera: Camera, k: int, pixel: np.ndarray, center: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (size^2,) and the mean albedo of the masked pixels (P, 3), over k x k places in each pixel.

    The mean is over the places that meet the mesh, so albedo isn't darkened at the edge; where none does, the
    centre's albedo stays.
    """
    size = camera.size
    row, column = np.divmod(np.arange(size * size), size)
    hits = np.zeros(size * size, np.float32)
    color = np.zeros((size * size, 3), np.float32)
    for dy in (np.arange(k) + 0.5) / k:
        for dx in (np.arange(k) + 0.5) / k:
            seen, face, weights = see(scene, camera, column + dx, row + dy)
            hits[seen] += 1
            color[seen] += albedo(mesh, face, weights)
    mean = np.where(hits[pixel, None] > 0, color[pixel] / np.maximum(hits[pixel, None], 1), center)
    return hits / k**2, mean
