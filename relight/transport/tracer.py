"""Path-traces meshes with Mitsuba 3, an independent check of the maps that shares no code with the baker.

Mitsuba is optional (`pip install '.[bench]'`). Its scalar variant is used, which needs no LLVM on the machine.
"""

import math
from types import ModuleType
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.srgb import LINEAR
from relight.meshes import Material, Mesh, vertex_normals
from relight.transport.camera import Camera
from relight.transport.surface import sample_albedo
from relight.transport.view import rotate_vectors

ROWS = 256  # of an environment map
MIN_EYE_DISTANCE = 4.0  # least distance of the orthographic camera from the origin


def import_mitsuba() -> ModuleType:
    """Imports Mitsuba and sets its variant; raises UserError if it is not installed."""
    try:
        import mitsuba
    except ImportError:
        raise UserError("path tracing needs Mitsuba, which is not installed: pip install '.[bench]'") from None
    mitsuba.set_variant("scalar_rgb")
    mitsuba.set_log_level(mitsuba.LogLevel.Error)  # it would warn whenever it rounds the number of samples up
    return mitsuba


class PathTracer:
    """Renders a mesh from a camera as of `bake`, with one Mitsuba shape per material.

    Albedo is that of the textures. If a mesh has vertex colors, it is the albedo at the corners, interpolated
    linearly.

    Attributes:
        mi: the module Mitsuba.
        size: side of the square image, pixels.
        camera: the camera of the maps to compare with.
        front: the largest z of the mesh in the camera's frame.
        shapes: Mitsuba's shapes by name.
    """

    def __init__(self, mesh: Mesh, size: int, camera: Camera | None = None, gloss: bool = False):
        """Creates the shapes.

        Args:
            mesh: aligned, if it is seen from the front.
            size: side of the square image, pixels; a pixel is the mean over its area.
            camera: whose picture is rendered, as `Baker.camera` returns it; by default the frontal one.
            gloss: whether glossy materials reflect; otherwise, all are diffuse.

        Raises:
            UserError: if Mitsuba is not installed.
        """
        self.mi, self.size, self.camera = import_mitsuba(), size, camera or Camera(size, MIN_EYE_DISTANCE)
        vertices, normals = mesh.vertices.astype(np.float64), vertex_normals(mesh).astype(np.float64)
        if pose := self.camera.pose:
            vertices, normals = pose.to_camera(vertices), rotate_vectors(pose.rotation, normals)
        self.front = float(vertices[:, 2].max())
        self.shapes = {}
        for number in np.unique(mesh.material):
            selected = mesh.material == number
            surface = self._diffuse(mesh, number)
            if gloss and mesh.materials[number].specular:
                surface = self._glossy(surface["reflectance"], mesh.materials[number])
            properties = self.mi.Properties()
            properties["bsdf"] = self.mi.load_dict({"type": "twosided", "bsdf": surface})
            face_count, corners = int(selected.sum()), mesh.faces[selected].ravel()
            attributes = {"has_vertex_normals": True, "has_vertex_texcoords": True, "props": properties}
            shape = self.mi.Mesh(f"material{number}", 3 * face_count, face_count, **attributes)
            if mesh.color is not None:
                color = sample_albedo(mesh, np.repeat(np.flatnonzero(selected), 3), np.tile(np.eye(3), (face_count, 1)))
                shape.add_attribute("vertex_color", 3, np.ascontiguousarray(color.ravel(), np.float32))
            parameters = self.mi.traverse(shape)
            for name, values in (("positions", vertices[corners]), ("normals", normals[corners])):
                parameters[f"vertex_{name}"] = np.ascontiguousarray(values.ravel(), np.float32)
            # Mitsuba's v runs from the top of a texture.
            uv = mesh.uv[selected].reshape(-1, 2) * [1, -1] + [0, 1]
            parameters["vertex_texcoords"] = np.ascontiguousarray(uv.ravel(), np.float32)
            parameters["faces"] = np.arange(3 * face_count, dtype=np.uint32)
            parameters.update()
            self.shapes[f"material{number}"] = shape

    def _diffuse(self, mesh: Mesh, number: int) -> dict[str, Any]:
        material = mesh.materials[number]
        if mesh.color is not None:
            reflectance: dict[str, Any] = {"type": "mesh_attribute", "name": "vertex_color"}
        elif material.texture is not None:
            values = LINEAR[material.texture] * np.asarray(material.color, np.float32)
            bitmap = self.mi.Bitmap(np.ascontiguousarray(values.clip(0, 1), np.float32))
            if material.wrap[0] != material.wrap[1]:
                raise UserError(f"a texture that goes on as {' and '.join(material.wrap)} cannot be path traced")
            reflectance = {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": material.wrap[0]}
        else:
            reflectance = {"type": "rgb", "value": np.clip(material.color, 0, 1).tolist()}
        return {"type": "diffuse", "reflectance": reflectance}

    def _glossy(self, reflectance: dict[str, Any], material: Material) -> dict[str, Any]:
        """Returns Mitsuba's settings for a dielectric reflection over the albedo.

        At grazing angles, the diffuse part is not quite Lambertian (Burley 2012, "Physically-based shading at Disney",
        section 5.3).
        """
        specular = 0.5 * material.specular  # 0.5 in Mitsuba, 1 in glTF: 4 % at normal incidence
        return {"type": "principled", "base_color": reflectance, "roughness": material.roughness, "specular": specular}

    def radiance(self, sky: np.ndarray, samples: int, bounces: int = 0, seed: int = 0) -> np.ndarray:
        """Renders the radiance toward the camera.

        Args:
            sky: (H,W,3) radiance, not negative, at `sky_directions`.
            samples: per pixel.
            bounces: number of bounces of interreflection.
            seed: random seed of the samples.

        Returns:
            (S,S,3) float32.
        """
        light = {"type": "envmap", "bitmap": self.mi.Bitmap(np.ascontiguousarray(sky, np.float32))}
        film = {"type": "hdrfilm", "width": self.size, "height": self.size, "rfilter": {"type": "box"}}
        film |= {"pixel_format": "rgb", "component_format": "float32"}
        sensor = {**self._sensor(), "film": film, "sampler": {"type": "multijitter", "sample_count": samples}}
        # A path of depth 2 goes from the eye over one surface to the sky; roulette would only add noise.
        path = {"type": "path", "max_depth": 2 + bounces, "rr_depth": 100, "hide_emitters": True}
        scene = {"type": "scene", "light": light, **self.shapes, "sensor": sensor, "integrator": path}
        return np.array(self.mi.render(self.mi.load_dict(scene), seed=seed))

    def _sensor(self) -> dict[str, Any]:
        eye = self.camera.distance if self.camera.perspective else max(MIN_EYE_DISTANCE, self.front + 1)
        to_world = self.mi.ScalarTransform4f().look_at(origin=[0, 0, eye], target=[0, 0, 0], up=[0, 1, 0])
        if not self.camera.perspective:
            return {"type": "orthographic", "to_world": to_world}
        fov, near = 2 * math.degrees(math.atan(1 / eye)), 1e-3  # degrees, and in units of the camera's frame
        return {"type": "perspective", "fov": fov, "near_clip": near, "to_world": to_world}


def sky_directions() -> np.ndarray:
    """Returns the directions (ROWS, 2 ROWS, 3) of the texels of a Mitsuba environment map, in the camera frame.

    Measured with mi.load_dict({"type": "envmap"}).eval: rows run from pole to pole inclusive, columns are at pixel
    centres, u = 1/4 is +x, and u = 1/2 is +z.
    """
    theta = np.linspace(0, np.pi, ROWS)[:, None]
    phi = 2 * np.pi * ((np.arange(2 * ROWS) + 0.5) / (2 * ROWS))[None]
    return np.stack([np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi, -np.sin(theta) * np.cos(phi)], -1)


def sky_weights() -> np.ndarray:
    """Returns the solid angles (ROWS, 2 ROWS) of the texels of a Mitsuba environment map; their sum is 4 pi."""
    sine = np.sin(np.linspace(0, np.pi, ROWS))
    return np.repeat((sine / sine.sum() * 2 * np.pi / ROWS)[:, None], 2 * ROWS, 1)
