"""Bakes the maps of one mesh: what the camera sees, and the light transport at each pixel."""

import math
from itertools import product

import numpy as np

from relight.files import UserError
from relight.maps.maps import Maps
from relight.meshes.mesh import Mesh
from relight.meshes.normals import vertex_normals
from relight.progress import progress
from relight.transport.bounce import reflectors
from relight.transport.camera import Camera
from relight.transport.integrate import BATCH, at_least, integrate
from relight.transport.sampling import azimuths
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
    figure's height), if given. Mask and depth are those of the pixel's centre. All other maps are means over k x k
    places of the pixel, k = `supersample`, which share out the pixel's rays: a mean over its surface, as pictures are,
    at no more rays. The mean is over the places that meet the mesh, so nothing is darkened at the edge; normals are
    made unit again. With `bounces` > 0, `bounced` holds what interreflection adds, with the mesh's albedo. Faces are
    seen from both sides; a visible back counts with its normal turned to the camera. `threads` = 0 takes every core;
    threads change no bit of the result. Time and memory: docs/transport.md.

    UserError on settings out of range, on meshes that Scene refuses, and when the camera sees nothing of the mesh.
    """
    at_least(1, rays=rays, supersample=supersample)
    at_least(0, order=order, bounces=bounces)
    if rays < supersample**2:
        raise UserError(
            f"rays is {rays}: it must be at least {supersample**2}, one for each of the pixel's {supersample} x "
            f"{supersample} places (supersample)"
        )
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
    backs = np.einsum("nx,nx->n", scene.normals[face], camera.toward(points)) < 0

    lit, radiosity = reflectors(mesh, scene, rays, order, seed, bounces) if bounces else (scene, None)
    corner_normals, azimuth = vertex_normals(mesh), azimuths(len(pixel), seed)
    number = np.full(size * size, -1)
    number[pixel] = np.arange(len(pixel))
    sums: dict[str, np.ndarray] = {}
    met, hits = np.zeros(size * size), np.zeros(len(pixel))

    def look(at: np.ndarray, face: np.ndarray, weights: np.ndarray, share: tuple[int, int]) -> None:
        """Adds what one place of each masked pixel `at` shows."""
        points, geometric = scene.points(face, weights), scene.normals[face]
        normals = shading_normals(corner_normals, mesh.faces, face, weights, geometric)
        side = np.where(np.einsum("nx,nx->n", geometric, camera.toward(points)) < 0, -1.0, 1.0)[:, None]
        normals, geometric = normals * side, geometric * side
        transport, bounced = integrate(
            lit, points, normals, geometric, rays, order, seed, radiosity, azimuth=azimuth[at], share=share
        )
        values = {"transport": transport, "normal": normals, "albedo": albedo(mesh, face, weights)}
        if bounced is not None:
            values["bounced"] = bounced
        for name, value in values.items():
            total = sums.setdefault(name, np.zeros((len(pixel), *value.shape[1:])))
            total[at] += value
        hits[at] += 1

    places = (np.arange(supersample) + 0.5) / supersample
    grid = list(product(places, places))
    for j, (dy, dx) in enumerate(progress(grid, "places of each pixel") if len(grid) > 1 else grid):
        seen, place_face, place_weights = see(scene, camera, column + dx, row + dy)
        met[seen] += 1
        masked = number[seen] >= 0
        look(number[seen[masked]], place_face[masked], place_weights[masked], (j, len(grid)))
    missed = np.flatnonzero(hits == 0)  # what shows is thinner than the places lie apart
    if len(missed):
        look(missed, face[missed], weights[missed], (0, 1))
    mean = {name: total / hits.reshape(-1, *[1] * (total.ndim - 1)) for name, total in sums.items()}
    length = np.linalg.norm(mean["normal"], axis=1, keepdims=True)
    transport = mean["transport"].astype(np.float32)

    def spread(values: np.ndarray) -> np.ndarray:
        image = np.zeros((size * size, *values.shape[1:]), values.dtype)
        image[pixel] = values
        return image.reshape(size, size, *values.shape[1:])

    return Maps(
        mask=spread(np.ones(len(pixel), bool)),
        coverage=(met / len(grid)).astype(np.float32).reshape(size, size),
        albedo=spread(mean["albedo"].astype(np.float32)),
        normal=spread((mean["normal"] / length).astype(np.float32)),
        depth=spread((camera.distance - points[:, 2]).astype(np.float32)),
        ao=spread((transport[:, 0] / np.float32(OPEN)).clip(0, 1)),
        transport=spread(transport),
        bounced=spread(mean["bounced"].astype(np.float32)) if bounces else None,
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
            "backs": round(float(backs.mean()), 4),  # share of the pixels that show the back of a face
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
