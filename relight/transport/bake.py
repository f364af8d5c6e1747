"""Bakes maps of a mesh: what a camera sees, and the light transport at each pixel."""

import math
from dataclasses import replace
from itertools import product

import numpy as np

from relight.files import UserError
from relight.maps.maps import Maps
from relight.meshes.mesh import Mesh
from relight.meshes.normals import vertex_normals
from relight.progress import progress
from relight.sh.rotation import rotation_matrix
from relight.transport.bounce import reflectors
from relight.transport.camera import Camera
from relight.transport.integrate import BATCH, at_least, integrate
from relight.transport.sampling import azimuths
from relight.transport.scene import MISS, Scene
from relight.transport.surface import albedo, shading_normals
from relight.transport.view import FRONTAL, View, pose, record

OPEN = math.sqrt(math.pi) / 2  # T00 of a point that nothing occludes, .8862


def bake(
    mesh: Mesh,
    size: int,
    rays: int,
    order: int = 2,
    seed: int = 0,
    supersample: int = 1,
    bounces: int = 0,
    view: View = FRONTAL,
    threads: int = 1,
) -> Maps:
    """Maps of one view of an aligned mesh: `Baker.maps`."""
    return Baker(mesh, rays, order, seed, bounces, threads).maps(size, supersample, view)


class Baker:
    """A mesh made ready to be baked from anywhere: what all views of it share is made once."""

    def __init__(self, mesh: Mesh, rays: int, order: int = 2, seed: int = 0, bounces: int = 0, threads: int = 1):
        """`rays` per pixel, (order + 1)^2 transport coefficients. With `bounces` > 0, maps hold in `bounced` what
        interreflection adds, with the mesh's albedo. `threads` = 0 takes every core; threads change no bit of the
        result. Time and memory: docs/transport.md. UserError on settings out of range and on meshes that Scene refuses.
        """
        at_least(1, rays=rays)
        at_least(0, order=order, bounces=bounces)
        self.mesh, self.rays, self.order, self.seed, self.bounces = mesh, rays, order, seed, bounces
        self.scene = Scene(mesh.vertices, mesh.faces, threads)
        self.normals = vertex_normals(mesh)
        self.lit, self.radiosity = self.scene, None
        if bounces:
            self.lit, self.radiosity = reflectors(mesh, self.scene, rays, order, seed, bounces)

    def camera(self, size: int, view: View) -> Camera:
        """The camera of a view: the frontal one leaves the mesh where it is, all others frame it (`pose`)."""
        scene = self.scene
        if view == FRONTAL:
            return Camera(size, max(2.0, float(scene.high[2]) + scene.diagonal / 100))
        used = np.zeros(len(self.mesh.vertices), bool)
        used[scene.faces] = True
        vertices = self.mesh.vertices[used].astype(np.float64)
        placed = pose(view, vertices)
        if view.focal is not None:
            return Camera(size, view.distance, True, placed)
        front = float(placed.to_camera(vertices)[:, 2].max())
        return Camera(size, max(2.0, front + placed.scale * scene.diagonal / 100), pose=placed)

    def maps(self, size: int, supersample: int = 1, view: View = FRONTAL) -> Maps:
        """`outfits`, of a mesh that has one or of which only its own is asked for."""
        return self.outfits(size, supersample, view)[0]

    def outfits(self, size: int, supersample: int = 1, view: View = FRONTAL) -> list[Maps]:
        """Maps of one view on a `size` px image, for each outfit of the mesh, its own first.

        Normals and transport are in the camera's axes, depth in its units. Outfits differ in albedo only, and cost no
        rays.

        Mask and depth are those of the pixel's centre. All other maps are means over k x k places of the pixel,
        k = `supersample`, which share out the pixel's rays: a mean over its surface, as pictures are, at no more rays.
        The mean is over the places that meet the mesh, so nothing is darkened at the edge; normals are made unit
        again. Faces are seen from both sides; a visible back counts with its normal turned to the camera. In
        perspective the axes are the same for all pixels, z along the optical axis, not along each pixel's ray.

        UserError on settings out of range and when the camera sees nothing of the mesh.
        """
        at_least(1, supersample=supersample)
        if self.rays < supersample**2:
            raise UserError(
                f"rays is {self.rays}: it must be at least {supersample**2}, one for each of the pixel's {supersample} "
                f"x {supersample} places (supersample)"
            )
        mesh, scene, camera = self.mesh, self.scene, self.camera(size, view)
        looks = [mesh.dressed(outfit) for outfit in range(len(mesh.outfits) + 1)]
        if self.bounces and len(looks) > 1:
            raise UserError("what surfaces reflect depends on their albedo: with outfits, bounces must be 0")
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

        azimuth = azimuths(len(pixel), self.seed)
        number = np.full(size * size, -1)
        number[pixel] = np.arange(len(pixel))
        sums: dict[str, np.ndarray] = {}
        met, hits = np.zeros(size * size), np.zeros(len(pixel))

        def look(at: np.ndarray, face: np.ndarray, weights: np.ndarray, share: tuple[int, int]) -> None:
            """Adds what one place of each masked pixel `at` shows."""
            points, geometric = scene.points(face, weights), scene.normals[face]
            normals = shading_normals(self.normals, mesh.faces, face, weights, geometric)
            side = np.where(np.einsum("nx,nx->n", geometric, camera.toward(points)) < 0, -1.0, 1.0)[:, None]
            normals, geometric = normals * side, geometric * side
            transport, bounced = integrate(
                self.lit,
                points,
                normals,
                geometric,
                self.rays,
                self.order,
                radiosity=self.radiosity,
                azimuth=azimuth[at],
                share=share,
            )
            painted = np.stack([albedo(look, face, weights) for look in looks], axis=1)
            values = {"transport": transport, "normal": normals, "albedo": painted}
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
        if camera.pose is not None:  # from the mesh's axes to the camera's
            turn = rotation_matrix(camera.pose.rotation, self.order)
            mean["normal"] = np.einsum("jk,pk->pj", camera.pose.rotation, mean["normal"])
            for name in ("transport", "bounced") if self.bounces else ("transport",):
                mean[name] = np.einsum("jk,pk...->pj...", turn, mean[name])
        length = np.linalg.norm(mean["normal"], axis=1, keepdims=True)
        transport = mean["transport"].astype(np.float32)

        def spread(values: np.ndarray) -> np.ndarray:
            image = np.zeros((size * size, *values.shape[1:]), values.dtype)
            image[pixel] = values
            return image.reshape(size, size, *values.shape[1:])

        painted = mean["albedo"].astype(np.float32)
        own = Maps(
            mask=spread(np.ones(len(pixel), bool)),
            coverage=(met / len(grid)).astype(np.float32).reshape(size, size),
            albedo=spread(painted[:, 0]),
            normal=spread((mean["normal"] / length).astype(np.float32)),
            depth=spread(camera.depth(points).astype(np.float32)),
            ao=spread((transport[:, 0] / np.float32(OPEN)).clip(0, 1)),
            transport=spread(transport),
            bounced=spread(mean["bounced"].astype(np.float32)) if self.bounces else None,
            info={
                **mesh.info,
                "size": size,
                "rays": self.rays,
                "order": self.order,
                "ray_seed": self.seed,  # the figure has a seed of its own
                "supersample": supersample,
                "bounces": self.bounces,
                "camera": "perspective" if camera.perspective else "orthographic",
                "camera_distance": round(camera.distance, 6),
                "offset": scene.offset,
                "backs": round(float(backs.mean()), 4),  # share of the pixels that show the back of a face
                **({} if camera.pose is None else {"view": record(view, camera.pose)}),
            },
        )
        others = (painted[:, number] for number in range(1, len(looks)))
        return [own, *(replace(own, albedo=spread(other), info=dict(own.info)) for other in others)]


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
