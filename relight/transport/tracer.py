"""Path tracing of a mesh by Mitsuba 3, which shares no code with the baker: an independent check of the maps.

Mitsuba is optional (`pip install mitsuba`). Its scalar variant is used, which needs no LLVM on the machine.
"""

import numpy as np

from relight.files import UserError
from relight.meshes import Mesh, vertex_normals
from relight.transport.surface import sample_albedo

ROWS = 256  # of an environment map
EYE = 4.0  # distance of the orthographic camera from the origin


def import_mitsuba():
    """Returns the module with its variant set; raises UserError if it is not installed."""
    try:
        import mitsuba
    except ImportError:
        raise UserError("path tracing is done by Mitsuba, which is not installed here: pip install mitsuba") from None
    mitsuba.set_variant("scalar_rgb")
    mitsuba.set_log_level(mitsuba.LogLevel.Error)  # it warns wherever it rounds the number of samples up
    return mitsuba


class PathTracer:
    """Renders an aligned mesh with the camera of `bake`; its albedo is interpolated from the corners of faces."""

    def __init__(self, mesh: Mesh, size: int):
        """Loads a mesh.

        Args:
            mesh: aligned.
            size: of the images in pixels; a pixel is the mean over its area.

        Raises:
            UserError: if Mitsuba is not installed.
        """
        self.mi, self.size = import_mitsuba(), size
        count = len(mesh.faces)
        corners = mesh.faces.ravel()
        color = sample_albedo(mesh, np.repeat(np.arange(count), 3), np.tile(np.eye(3), (count, 1)))
        diffuse = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
        properties = self.mi.Properties()
        properties["bsdf"] = self.mi.load_dict({"type": "twosided", "bsdf": diffuse})
        self.shape = self.mi.Mesh("figure", 3 * count, count, has_vertex_normals=True, props=properties)
        self.shape.add_attribute("vertex_color", 3, np.ascontiguousarray(color.ravel(), np.float32))
        parameters = self.mi.traverse(self.shape)
        parameters["vertex_positions"] = np.ascontiguousarray(mesh.vertices[corners].ravel(), np.float32)
        parameters["vertex_normals"] = np.ascontiguousarray(vertex_normals(mesh)[corners].ravel(), np.float32)
        parameters["faces"] = np.arange(3 * count, dtype=np.uint32)
        parameters.update()

    def radiance(self, sky: np.ndarray, samples: int, bounces: int = 0, seed: int = 0) -> np.ndarray:
        """Renders the radiance toward the camera.

        Args:
            sky: (H,W,3) radiance, not negative, at `sky_directions`.
            samples: per pixel.
            bounces: of interreflection.
            seed: of the samples.

        Returns:
            (S,S,3) float32.
        """
        return self._render(sky, samples, path_integrator(bounces), seed)

    def irradiance(self, sky: np.ndarray, samples: int, bounces: int = 0, seed: int = 0) -> np.ndarray:
        """Renders the irradiance of the visible surface: radiance times pi over the albedo of the same samples.

        Args:
            sky: (H,W,3) radiance; may be negative, as truncated series are. Both signs are rendered separately, since
                light is additive.
            samples: per pixel.
            bounces: of interreflection.
            seed: of the samples.

        Returns:
            (S,S,3) float64, the mean over the covered part of each pixel; zero where there is no mesh.
        """
        both = {"type": "aov", "aovs": "albedo:albedo", "path": path_integrator(bounces)}
        total = np.zeros((self.size, self.size, 3))
        for sign in (1, -1):
            part = np.maximum(sign * sky, 0)
            if part.any():
                radiance, color = np.split(self._render(part, samples, both, seed), 2, axis=-1)
                total += sign * np.pi * radiance / np.maximum(color, 1e-6)
        return total

    def _render(self, sky: np.ndarray, samples: int, integrator: dict, seed: int) -> np.ndarray:
        scene = self.mi.load_dict(
            {
                "type": "scene",
                "light": {"type": "envmap", "bitmap": self.mi.Bitmap(np.ascontiguousarray(sky, np.float32))},
                "shape": self.shape,
                "sensor": {
                    "type": "orthographic",
                    "to_world": self.mi.ScalarTransform4f().look_at(origin=[0, 0, EYE], target=[0, 0, 0], up=[0, 1, 0]),
                    "film": {
                        "type": "hdrfilm",
                        "width": self.size,
                        "height": self.size,
                        "rfilter": {"type": "box"},
                        "pixel_format": "rgb",
                        "component_format": "float32",
                    },
                    "sampler": {"type": "multijitter", "sample_count": samples},
                },
                "integrator": integrator,
            }
        )
        return np.array(self.mi.render(scene, seed=seed))


def path_integrator(bounces: int) -> dict:
    """Returns Mitsuba's settings for all paths of up to `bounces` bounces, with the sky itself invisible."""
    return {"type": "path", "max_depth": 2 + bounces, "rr_depth": 100, "hide_emitters": True}


def sky_directions(rows: int = ROWS) -> np.ndarray:
    """Returns the directions (rows, 2 rows, 3) of the texels of a Mitsuba environment map, in the camera frame.

    Measured on mi.load_dict({"type": "envmap"}).eval: rows run from pole to pole inclusive, columns are centres, and
    u = 1/4 is +x, u = 1/2 is +z.
    """
    theta = np.linspace(0, np.pi, rows)[:, None]
    phi = 2 * np.pi * ((np.arange(2 * rows) + 0.5) / (2 * rows))[None]
    return np.stack([np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi, -np.sin(theta) * np.cos(phi)], -1)


def sky_weights(rows: int = ROWS) -> np.ndarray:
    """Returns the solid angles (rows, 2 rows) of the texels of a Mitsuba environment map; their sum is 4 pi."""
    sine = np.sin(np.linspace(0, np.pi, rows))
    return np.repeat((sine / sine.sum() * 2 * np.pi / rows)[:, None], 2 * rows, 1)


def block_means(image: np.ndarray, k: int) -> np.ndarray:
    """Returns the means (H/k,W/k,...) over the k x k blocks of an image (H,W,...)."""
    height, width = image.shape[0] // k, image.shape[1] // k
    return image.reshape(height, k, width, k, *image.shape[2:]).mean((1, 3))


def interior_blocks(mask: np.ndarray, k: int) -> np.ndarray:
    """Returns which k x k blocks, (H/k,W/k) bool, lie in a mask (H,W) together with their eight neighbours."""
    full = block_means(mask.astype(float), k) == 1
    padded = np.pad(full, 1)
    rows, columns = full.shape
    return np.all([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], 0)
