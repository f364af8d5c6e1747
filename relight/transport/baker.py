"""Bakes maps of a mesh: the surface that a camera sees, and the light transport at each pixel."""

from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from relight.core.errors import UserError
from relight.core.progress import progress
from relight.maps import Maps
from relight.meshes import Mesh, vertex_normals
from relight.settings import Bake, read_preset
from relight.sh import UNOCCLUDED_T00, rotation_matrix
from relight.transport.bounce import solve_radiosity
from relight.transport.camera import Camera
from relight.transport.integrate import BATCH, integrate, require_at_least
from relight.transport.raycaster import MISS, RayCaster
from relight.transport.sampling import random_azimuths
from relight.transport.surface import sample_albedo, sample_gloss, shading_normals
from relight.transport.view import FRONTAL, View, place_mesh, view_record

MIN_CAMERA_DISTANCE = 2.0  # of an orthographic camera from the origin, in units of the image plane


def bake(
    mesh: Mesh, size: int, rays: int, view: View = FRONTAL, seed: int = 0, threads: int = 1, **others: Any
) -> Maps:
    """Bakes maps of one view of a mesh (equation 7 of the paper). `Baker` bakes several views faster.

    Args:
        mesh: aligned; the camera sees x and y from -1 to 1.
        size: side of the image, pixels.
        rays: per pixel.
        view: of the camera.
        seed, threads: as in `Baker`.
        others: other settings of the group `bake`, by name; by default those of conf/bake/default.yaml.

    Raises:
        UserError: as `Baker` does.
    """
    return Baker(mesh, replace(read_preset("bake"), size=size, rays=rays, **others), seed, threads).maps(view)


class Baker:
    """Bakes maps of any number of views of one mesh; the views share all preparations.

    Attributes:
        mesh: the mesh.
        settings: of the baker.
        caster: casts camera rays against the mesh.
    """

    def __init__(self, mesh: Mesh, settings: Bake, seed: int = 0, threads: int = 1):
        """Prepares a mesh. Time and memory: docs/lab/transport.md.

        Args:
            mesh: aligned, with its outfits.
            settings: of the baker; `views` is for its callers.
            seed: of the azimuths of the rays.
            threads: of the ray caster, 0 for one per core; the maps do not depend on it.

        Raises:
            UserError: if the mesh has no faces, or for settings that cannot be baked.
        """
        require_at_least(1, size=settings.size, rays=settings.rays, supersample=settings.supersample)
        require_at_least(0, order=settings.order, bounces=settings.bounces)
        if settings.rays < (samples := settings.supersample**2):
            raise UserError(f"rays is {settings.rays}: it must be at least {samples}, one for each sample of a pixel")
        if settings.bounces and mesh.outfits:
            raise UserError("bounced light depends on the albedo: with several outfits, bounces must be 0")
        self.mesh, self.settings, self.seed = mesh, settings, seed
        self.outfit_meshes = [mesh.dressed(outfit) for outfit in range(1 + len(mesh.outfits))]
        self.glossy = any(material.specular for outfit_mesh in self.outfit_meshes for material in outfit_mesh.materials)
        self.caster = RayCaster(mesh.vertices, mesh.faces, threads)
        self.normals = vertex_normals(mesh)
        self.gather_caster, self.radiosity = self.caster, None
        if settings.bounces:
            self.gather_caster, self.radiosity = solve_radiosity(
                mesh, self.caster, settings.rays, settings.order, seed, settings.bounces
            )

    def camera(self, view: View) -> Camera:
        """Returns the camera of a view.

        The frontal view shows the mesh in its own frame; other views place it to fill the picture (`place_mesh`). An
        orthographic camera stands at MIN_CAMERA_DISTANCE from the origin, or a hundredth of the mesh's diagonal before
        its foremost point, if that is farther.
        """
        caster, size = self.caster, self.settings.size
        if view == FRONTAL:
            return Camera(size, max(MIN_CAMERA_DISTANCE, float(caster.high[2]) + caster.diagonal / 100))
        used = np.zeros(len(self.mesh.vertices), bool)
        used[caster.faces] = True
        vertices = self.mesh.vertices[used].astype(np.float64)
        pose = place_mesh(view, vertices)
        if view.distance is not None:
            return Camera(size, view.distance, True, pose)
        front = float(pose.to_camera(vertices)[:, 2].max())
        return Camera(size, max(MIN_CAMERA_DISTANCE, front + pose.scale * caster.diagonal / 100), pose=pose)

    def maps(self, view: View = FRONTAL) -> Maps:
        """Bakes maps of one view of the mesh in its own outfit: the first of `outfits`."""
        return self.outfits(view)[0]

    def outfits(self, view: View = FRONTAL) -> list[Maps]:
        """Bakes maps of one view in each outfit: normals and transport in the camera's axes, depth in its units.

        Outfits differ in albedo and gloss only, and need no additional rays.

        Mask and depth are sampled at pixel centres. The other maps are means over k x k samples of a pixel, k =
        `supersample`. The samples share the pixel's rays, so filtering costs no additional rays. Samples that miss the
        mesh do not count, to avoid dark silhouettes; mean normals are normalised. Back faces are visible, with normals
        turned to the camera. In perspective, all pixels have the same axes, with z along the optical axis.

        Returns:
            The maps of each of `outfit_meshes`.

        Raises:
            UserError: if no pixel centre shows the mesh.
        """
        size, camera = self.settings.size, self.camera(view)
        centres = primary_hits(self.caster, camera, *pixel_corners(size) + 0.5)
        if not len(centres.ray):
            low, high = self.caster.low, self.caster.high
            span = ", ".join(f"{axis} {a:.3g} to {b:.3g}" for axis, a, b in zip("xyz", low, high))
            if view != FRONTAL or (np.abs([low[:2], high[:2]]) <= 1).all():
                advice = f"it is thinner than the pixels of an image of {size} x {size}: give a larger size"
            else:
                advice = "the image shows x and y from -1 to 1: align it first"
            raise UserError(f"the camera sees nothing of the mesh, which spans {span}; {advice}")
        means, coverage = self._pixel_means(camera, centres)
        if camera.pose is not None:
            matrix = rotation_matrix(camera.pose.rotation, self.settings.order)
            means["normal"] = np.einsum("jk,pk->pj", camera.pose.rotation, means["normal"])
            for name in {"transport", "bounced"} & set(means):
                means[name] = np.einsum("jk,pk...->pj...", matrix, means[name])
        means["normal"] = means["normal"] / np.linalg.norm(means["normal"], axis=1, keepdims=True)
        return self._to_maps(means, coverage, centres, camera, view)

    def _pixel_means(self, camera: Camera, centres: "Hits") -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Averages the samples of the P pixels whose centres hit the mesh.

        `centres` are hits of the rays through the pixels' centres. Returns means (P,...) of `_surface_values` in the
        mesh's axes, and coverage (size^2,), the share of samples that hit.
        """
        column, row = pixel_corners(camera.size)
        azimuth = random_azimuths(len(centres.ray), self.seed)
        pixel_index = np.full(camera.size**2, -1)  # from pixels of the image to the P, -1 for the others
        pixel_index[centres.ray] = np.arange(len(centres.ray))
        counts, covered = np.zeros(len(centres.ray)), np.zeros(camera.size**2)
        sums: dict[str, np.ndarray] = {}

        def add(pixels: np.ndarray, face: np.ndarray, weights: np.ndarray, subset: tuple[int, int]) -> None:
            """Adds a sample to each of some of the P pixels."""
            for name, values in self._surface_values(camera, face, weights, azimuth[pixels], subset).items():
                total = sums.setdefault(name, np.zeros((len(counts), *values.shape[1:])))
                total[pixels] += values
            counts[pixels] += 1

        offsets = (np.arange(self.settings.supersample) + 0.5) / self.settings.supersample
        grid = list(product(offsets, offsets))
        for j, (dy, dx) in enumerate(progress(grid, "samples per pixel") if len(grid) > 1 else grid):
            hits = primary_hits(self.caster, camera, column + dx, row + dy)
            covered[hits.ray] += 1
            masked = pixel_index[hits.ray] >= 0
            add(pixel_index[hits.ray[masked]], hits.face[masked], hits.weights[masked], subset=(j, len(grid)))
        unsampled = np.flatnonzero(counts == 0)  # the surface is thinner than the samples' spacing
        if len(unsampled):
            add(unsampled, centres.face[unsampled], centres.weights[unsampled], subset=(0, 1))
        means = {name: total / counts.reshape(-1, *[1] * (total.ndim - 1)) for name, total in sums.items()}
        return means, covered / len(grid)

    def _surface_values(
        self, camera: Camera, face: np.ndarray, weights: np.ndarray, azimuth: np.ndarray, subset: tuple[int, int]
    ) -> dict[str, np.ndarray]:
        """Computes the values of N points of the surface.

        `weights` (N,3) are barycentric, `azimuth` (N,) is that of the rays in radians, and `subset` (j, m) casts every
        m-th of the rays from the j-th on. Returns `transport` (N,K), `normal` (N,3) turned to the camera, and `albedo`
        (N,O,3) of O outfits; `gloss` (N,O,2) for glossy meshes; `bounced` (N,K,3) with bounces.
        """
        points, geometric = self.caster.points(face, weights), self.caster.normals[face]
        normals = shading_normals(self.normals, self.mesh.faces, face, weights, geometric)
        sign = np.where(faces_away(camera, points, geometric), -1.0, 1.0)[:, None]
        normals, geometric = normals * sign, geometric * sign
        surface, counts = (points, normals, geometric), (self.settings.rays, self.settings.order)
        transport, bounced = integrate(
            self.gather_caster, *surface, *counts, radiosity=self.radiosity, azimuth=azimuth, subset=subset
        )
        albedo = np.stack([sample_albedo(outfit_mesh, face, weights) for outfit_mesh in self.outfit_meshes], axis=1)
        values = {"transport": transport, "normal": normals, "albedo": albedo}
        if self.glossy:
            values["gloss"] = np.stack([sample_gloss(outfit_mesh, face) for outfit_mesh in self.outfit_meshes], axis=1)
        return values if bounced is None else {**values, "bounced": bounced}

    def _to_maps(
        self, means: dict[str, np.ndarray], coverage: np.ndarray, centres: "Hits", camera: Camera, view: View
    ) -> list[Maps]:
        """Returns the maps of each outfit: images of the pixels' means, with the settings as `info`.

        `means` (P,...) are those of `_surface_values` in the camera's axes, at the P pixels whose `centres` hit the
        mesh. `coverage` (size^2,) is the share of each pixel's samples that hit it.
        """
        settings, size = self.settings, camera.size
        points = self.caster.points(centres.face, centres.weights)
        is_back = faces_away(camera, points, self.caster.normals[centres.face])
        transport = means["transport"].astype(np.float32)

        def to_image(values: np.ndarray) -> np.ndarray:
            pixels = np.zeros((size * size, *values.shape[1:]), values.dtype)
            pixels[centres.ray] = values
            return pixels.reshape(size, size, *values.shape[1:])

        names = ("albedo", "gloss") if self.glossy else ("albedo",)
        outfit_layers = [
            {name: to_image(means[name][:, outfit].astype(np.float32)) for name in names}
            for outfit in range(len(self.outfit_meshes))
        ]
        maps = Maps(
            mask=to_image(np.ones(len(centres.ray), bool)),
            coverage=coverage.astype(np.float32).reshape(size, size),
            **outfit_layers[0],
            normal=to_image(means["normal"].astype(np.float32)),
            depth=to_image(camera.depth(points).astype(np.float32)),
            ao=to_image((transport[:, 0] / np.float32(UNOCCLUDED_T00)).clip(0, 1)),
            transport=to_image(transport),
            bounced=to_image(means["bounced"].astype(np.float32)) if "bounced" in means else None,
            info={
                **self.mesh.info,
                "size": size,
                "rays": settings.rays,
                "order": settings.order,
                "ray_seed": self.seed,  # `seed` is that of the figure
                "supersample": settings.supersample,
                "bounces": settings.bounces,
                "camera": "perspective" if camera.perspective else "orthographic",
                "camera_distance": round(camera.distance, 6),
                "offset": self.caster.offset,
                "backs": round(float(is_back.mean()), 4),  # share of pixels that show back faces
                **({} if camera.pose is None else {"view": view_record(view, camera.pose)}),
            },
        )
        return [maps, *(replace(maps, **layers, info=dict(maps.info)) for layers in outfit_layers[1:])]


class Hits(NamedTuple):
    """First intersections of rays with a mesh.

    Attributes:
        ray: (P,) indices of the rays that hit, ascending.
        face: (P,) that is hit.
        weights: (P,3) barycentric weights of the face's corners.
    """

    ray: np.ndarray
    face: np.ndarray
    weights: np.ndarray


def primary_hits(caster: RayCaster, camera: Camera, column: np.ndarray, row: np.ndarray) -> Hits:
    """Casts camera rays through points of the image and returns where they hit the mesh.

    Args:
        caster: casts rays at the mesh.
        camera: in the mesh's frame.
        column: (N,) in pixels from the left edge of the image; .5 is the centre of the first pixel.
        row: (N,) in pixels from the top edge.
    """
    hits = []
    for begin in range(0, len(column), BATCH):
        rays = camera.rays(column[begin : begin + BATCH], row[begin : begin + BATCH])
        rays[:, :3] -= caster.centre
        face, barycentric = caster.intersect(rays.astype(np.float32))
        hit = np.flatnonzero(face != MISS)
        hits.append((hit + begin, face[hit].astype(np.int64), barycentric[hit]))
    return Hits(*map(np.concatenate, zip(*hits)))


def pixel_corners(size: int) -> np.ndarray:
    """Returns column and row (2, size^2) of the top left corners of all pixels, in raster order."""
    row, column = np.divmod(np.arange(size * size), size)
    return np.stack([column, row])


def faces_away(camera: Camera, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Returns whether normals (N,3) at points (N,3), in the mesh's frame, point away from the camera, (N,) bool."""
    return np.einsum("nx,nx->n", normals, camera.toward(points)) < 0
